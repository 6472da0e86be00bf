//! NumPy's files: `.npy` holds one array, `.npz` several by name, and texts.

use npyz::WriterBuilder;
use std::io::{self, Seek, Write};

/// An array to write, in C order.
#[derive(Debug)]
pub struct Array<'a> {
    /// Its shape; the product is the number of values.
    pub shape: Vec<u64>,
    /// Its values.
    pub values: Values<'a>,
}

/// The values of an array.
#[derive(Clone, Copy, Debug)]
pub enum Values<'a> {
    /// float32.
    F32(&'a [f32]),
    /// uint32.
    U32(&'a [u32]),
    /// bool, from 0 and 1.
    Bool(&'a [u32]),
}

impl Values<'_> {
    /// The number of values.
    pub fn count(&self) -> usize {
        match self {
            Self::F32(values) => values.len(),
            Self::U32(values) | Self::Bool(values) => values.len(),
        }
    }
}

impl Array<'_> {
    /// Writes the array as `.npy`.
    ///
    /// # Errors
    /// Those of `file`.
    pub fn write_npy(&self, file: impl Write) -> io::Result<()> {
        match self.values {
            Values::F32(values) => self.write_values(file, values.iter().copied()),
            Values::U32(values) => self.write_values(file, values.iter().copied()),
            Values::Bool(values) => self.write_values(file, values.iter().map(|&bit| bit != 0)),
        }
    }

    fn write_values<T: npyz::AutoSerialize>(
        &self,
        file: impl Write,
        values: impl Iterator<Item = T>,
    ) -> io::Result<()> {
        let mut npy = npyz::WriteOptions::new().default_dtype().shape(&self.shape).writer(file).begin_nd()?;
        npy.extend(values)?;
        npy.finish()
    }
}

/// An `.npz` file being written.
pub struct Npz<W: Write + Seek>(zip::ZipWriter<W>);

impl<W: Write + Seek> std::fmt::Debug for Npz<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Npz").finish_non_exhaustive()
    }
}

impl<W: Write + Seek> Npz<W> {
    /// An empty file.
    pub fn new(file: W) -> Self {
        Self(zip::ZipWriter::new(file))
    }

    /// Appends an array, which `numpy.load` gives by its name.
    ///
    /// # Errors
    /// Those of the file.
    pub fn array(&mut self, name: &str, array: &Array<'_>) -> io::Result<()> {
        self.begin(&npyz::npz::file_name_from_array_name(name))?;
        array.write_npy(&mut self.0)
    }

    /// Appends a text, which `numpy.load` gives as bytes by its name.
    ///
    /// # Errors
    /// Those of the file.
    pub fn text(&mut self, name: &str, text: &str) -> io::Result<()> {
        self.begin(name)?;
        self.0.write_all(text.as_bytes())
    }

    fn begin(&mut self, name: &str) -> io::Result<()> {
        let stored = zip::write::SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Stored)
            .large_file(true);
        Ok(self.0.start_file(name, stored)?)
    }

    /// Completes the file.
    ///
    /// # Errors
    /// Those of the file.
    pub fn finish(self) -> io::Result<()> {
        self.0.finish()?;
        Ok(())
    }
}
