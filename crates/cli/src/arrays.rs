//! Reads and writes NumPy files.

use anyhow::{Context, Result, bail, ensure};
use raystream::files;
use raystream::memory::MemoryBudget;
use raystream::numpy::{Array, Npz, Values};
use raystream::picture::afford;
use raystream::stream::Ray;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Reads rays: float32 (n, 8) = origin xyz, `t_min`, direction xyz, `t_max`. The file may be a pipe.
pub fn read_rays(path: &Path, memory: &MemoryBudget) -> Result<Vec<Ray>> {
    let name = path.display();
    let file = File::open(path).with_context(|| format!("{name}: cannot be read"))?;
    let about = file.metadata().with_context(|| format!("{name}: cannot be read"))?;
    let npy = npyz::NpyFile::new(BufReader::new(file)).with_context(|| format!("{name}: not a .npy file"))?;
    let shape = npy.shape().to_vec();
    let [rows, 8] = shape[..] else {
        bail!("{name}: rays are float32 of shape (n, 8), but the file's shape is {shape:?}");
    };
    ensure!(npy.order() == npyz::Order::C, "{name}: the array is in Fortran order; save it in C order");
    let dtype = npy.dtype().descr();
    let values = npy.data::<f32>().with_context(|| {
        format!("{name}: rays are float32, but the file holds {dtype}; convert it with astype")
    })?;
    let bytes = rows.saturating_mul(size_of::<Ray>() as u64);
    // A pipe tells no length.
    let length = about.len();
    ensure!(
        !about.is_file() || bytes <= length,
        "{name}: the header promises {rows} rays of 32 bytes, but the file has {length} bytes; the file is truncated"
    );
    afford(memory, format!("{name}: {rows} rays"), bytes)?;
    // The rays of a pipe come or do not, whatever its header promises.
    let mut rays = Vec::with_capacity(if about.is_file() { rows as usize } else { 0 });
    let mut ray = [0.0_f32; 8];
    for (i, value) in values.enumerate() {
        ray[i % 8] = value.with_context(|| {
            format!("{name}: the header promises {rows} rays, but the file is truncated after {}", i / 8)
        })?;
        if i % 8 == 7 {
            rays.push(bytemuck::cast(ray));
        }
    }
    Ok(rays)
}

/// Refuses names of array files that do not end in `.npz`.
pub fn check_npz(path: &Path) -> Result<()> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    ensure!(
        extension.eq_ignore_ascii_case("npz"),
        "{}: arrays are written as .npz; give the file that extension",
        path.display()
    );
    Ok(())
}

/// Writes arrays as `.npz`, each with its name and the length of its second axis (0 for one-dimensional arrays).
pub fn write_npz(path: &Path, arrays: &[(impl AsRef<str>, u64, Values<'_>)]) -> Result<()> {
    files::write(path, |file| {
        let mut npz = Npz::new(file);
        for &(ref name, columns, values) in arrays {
            let len = values.count() as u64;
            let shape = len.checked_div(columns).map_or(vec![len], |rows| vec![rows, columns]);
            npz.array(name.as_ref(), &Array { shape, values })?;
        }
        npz.finish()
    })?;
    Ok(())
}
