//! Planes of numbers, one for each pixel, and means over squares of pixels.

use std::sync::{Mutex, PoisonError};

/// One number for each pixel, row by row.
pub(super) type Plane = Vec<f32>;

/// Means over the squares of `2 · radius + 1` pixels around each pixel. At the border the nearest pixels repeat.
pub(super) fn blurred(plane: &[f32], width: usize, radius: usize) -> Plane {
    let height = plane.len() / width.max(1);
    let side = 2 * radius + 1;
    let (mut row, mut across) = (vec![0.0; width + 2 * radius], vec![0.0; plane.len()]);
    for (from, to) in plane.chunks_exact(width).zip(across.chunks_exact_mut(width)) {
        for (i, value) in row.iter_mut().enumerate() {
            *value = from[i.saturating_sub(radius).min(width - 1)];
        }
        for start in 0..side {
            add(to, &row[start..]);
        }
    }
    let mut means = vec![0.0; plane.len()];
    let scale = 1.0 / (side * side) as f32;
    for (y, to) in means.chunks_exact_mut(width).enumerate() {
        for row in y..y + side {
            let row = row.saturating_sub(radius).min(height - 1);
            add(to, &across[row * width..]);
        }
        to.iter_mut().for_each(|sum| *sum *= scale);
    }
    means
}

/// The greatest of each pixel and its eight neighbours.
pub(super) fn greatest(plane: &[f32], width: usize) -> Plane {
    let height = plane.len() / width.max(1);
    let mut all = plane.to_vec();
    for (from, to) in plane.chunks_exact(width).zip(all.chunks_exact_mut(width)) {
        for (i, most) in to.iter_mut().enumerate() {
            *most = from[i].max(from[i.saturating_sub(1)]).max(from[(i + 1).min(width - 1)]);
        }
    }
    let across = all.clone();
    for (y, to) in all.chunks_exact_mut(width).enumerate() {
        let (above, below) = (y.saturating_sub(1) * width, (y + 1).min(height - 1) * width);
        for (i, most) in to.iter_mut().enumerate() {
            *most = most.max(across[above + i]).max(across[below + i]);
        }
    }
    all
}

fn add(to: &mut [f32], from: &[f32]) {
    for (sum, value) in to.iter_mut().zip(from) {
        *sum += value;
    }
}

/// Runs each task once, on `threads` threads.
pub(super) fn in_parallel<T: Send>(threads: usize, tasks: Vec<T>, run: impl Fn(T) + Sync) {
    let threads = threads.min(tasks.len());
    let tasks = Mutex::new(tasks.into_iter());
    let work = || {
        loop {
            let next = tasks.lock().unwrap_or_else(PoisonError::into_inner).next();
            match next {
                Some(task) => run(task),
                None => break,
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(work);
        }
        work();
    });
}

/// [`blurred`] planes, in their order.
pub(super) fn all_blurred(threads: usize, planes: &[&[f32]], width: usize, radius: usize) -> Vec<Plane> {
    let mut all = vec![Plane::new(); planes.len()];
    let tasks = all.iter_mut().zip(planes).collect();
    in_parallel(threads, tasks, |(to, plane): (&mut Plane, &&[f32])| *to = blurred(plane, width, radius));
    all
}
