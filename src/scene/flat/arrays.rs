//! Arrays one after another, with a hash over all of them.

use super::FlatError;
use super::head::{BYTES, Head};
use bytemuck::{NoUninit, Pod};
use std::borrow::Cow;
use std::fs::File;
use std::io::{BufReader, Read};
use std::sync::Arc;
use std::vec::IntoIter;
use xxhash_rust::xxh3::Xxh3;

/// Each array begins at a multiple of this.
const ALIGNMENT: usize = 16;

/// Zeros that follow an array of so many bytes.
fn padding(length: u64) -> usize {
    (length.next_multiple_of(ALIGNMENT as u64) - length) as usize
}

/// Arrays to be written, in their order.
#[derive(Debug, Default)]
pub struct Writer<'a> {
    arrays: Vec<Cow<'a, [u8]>>,
}

impl<'a> Writer<'a> {
    /// Adds an array behind the others.
    pub fn put<T: NoUninit>(&mut self, array: &'a [T]) {
        self.arrays.push(Cow::Borrowed(bytemuck::cast_slice(array)));
    }

    /// Adds an array before the others.
    pub fn put_first(&mut self, bytes: Vec<u8>) {
        self.arrays.insert(0, Cow::Owned(bytes));
    }

    /// The head, but for the number of triangles.
    pub fn head(&self) -> Head {
        let bytes: u64 = self.pieces().map(|piece| piece.len() as u64).sum();
        Head { arrays: self.arrays.len() as u32, length: BYTES as u64 + bytes, triangles: 0 }
    }

    /// The bytes behind the head: lengths of the arrays, then the arrays.
    pub fn pieces(&self) -> impl Iterator<Item = Cow<'_, [u8]>> {
        let lengths: Vec<u8> =
            self.arrays.iter().flat_map(|array| (array.len() as u64).to_le_bytes()).collect();
        let arrays = self.arrays.iter().map(|array| Cow::Borrowed(&**array));
        std::iter::once(Cow::Owned(lengths)).chain(arrays).flat_map(|piece| {
            let zeros = padding(piece.len() as u64);
            [piece, Cow::Borrowed(&[0; ALIGNMENT][..zeros])]
        })
    }

    /// The hash of head and pieces.
    pub fn hash(&self, head: &Head) -> u128 {
        let mut hash = Xxh3::new();
        hash.update(&head.hashed());
        self.pieces().for_each(|piece| hash.update(&piece));
        hash.digest128()
    }
}

/// Arrays that are read, in their order.
pub struct Reader {
    file: BufReader<File>,
    lengths: IntoIter<u64>,
    hash: Xxh3,
    expected: u128,
}

impl Reader {
    /// Reads head and lengths of a file of this length.
    pub fn new(file: File, length: u64) -> Result<Self, FlatError> {
        let mut file = BufReader::new(file);
        let (head, expected) = Head::read(&mut file, length)?;
        let mut hash = Xxh3::new();
        hash.update(&head.hashed());
        let mut reader = Self { file, lengths: Vec::new().into_iter(), hash, expected };
        let table = u64::from(head.arrays) * 8;
        let short = || FlatError::damaged("its arrays are longer than the file");
        // Nothing is allocated that the file does not hold.
        let mut left = length.checked_sub(BYTES as u64 + table + padding(table) as u64).ok_or_else(short)?;
        let mut lengths = vec![0_u64; head.arrays as usize];
        reader.fill(&mut lengths)?;
        for &length in &lengths {
            let padded = length.checked_next_multiple_of(ALIGNMENT as u64).ok_or_else(short)?;
            left = left.checked_sub(padded).ok_or_else(short)?;
        }
        if left > 0 {
            return Err(FlatError::damaged(format!("{left} bytes belong to no array")));
        }
        reader.lengths = lengths.into_iter();
        Ok(reader)
    }

    /// The next array.
    pub fn take<T: Pod>(&mut self) -> Result<Vec<T>, FlatError> {
        let mut array = vec![T::zeroed(); self.next_count::<T>()?];
        self.fill(&mut array)?;
        Ok(array)
    }

    /// The next array, to be shared.
    pub fn take_shared<T: Pod>(&mut self) -> Result<Arc<[T]>, FlatError> {
        let count = self.next_count::<T>()?;
        let mut array: Arc<[T]> = std::iter::repeat_n(T::zeroed(), count).collect();
        self.fill(Arc::get_mut(&mut array).expect("it has one owner"))?;
        Ok(array)
    }

    /// The number of elements of the next array.
    fn next_count<T>(&mut self) -> Result<usize, FlatError> {
        let length = self.lengths.next().ok_or_else(|| FlatError::damaged("an array is missing"))?;
        let size = size_of::<T>() as u64;
        if length % size != 0 {
            return Err(FlatError::damaged(format!(
                "an array of {length} bytes has elements of {size} bytes"
            )));
        }
        usize::try_from(length / size).map_err(|_| FlatError::damaged("an array is too long"))
    }

    /// Reads an array and the zeros behind it.
    fn fill<T: Pod>(&mut self, array: &mut [T]) -> Result<(), FlatError> {
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(array);
        let mut zeros = [0; ALIGNMENT];
        let zeros = &mut zeros[..padding(bytes.len() as u64)];
        for part in [bytes, zeros] {
            self.file.read_exact(part).map_err(|error| match error.kind() {
                std::io::ErrorKind::UnexpectedEof => FlatError::damaged("it is cut"),
                _ => error.into(),
            })?;
            self.hash.update(part);
        }
        Ok(())
    }

    /// Checks that all arrays have been taken and that the hash is right.
    pub fn finish(&mut self) -> Result<(), FlatError> {
        if self.lengths.next().is_some() {
            return Err(FlatError::damaged("it has more arrays than its scene"));
        }
        match self.hash.digest128() == self.expected {
            true => Ok(()),
            false => Err(FlatError::damaged("its hash is another")),
        }
    }
}
