//! The host's results for the points of a kernel.

use crate::lanes::SimdLevel;
use crate::program::device::{Kernel, Program};
use crate::program::run::{BLOCK, Columns, run_alone};
use crate::program::source::ShaderError;

impl Program {
    /// Computes the columns of a kernel's results from those of its inputs, both of `points` words each.
    ///
    /// # Errors
    /// When a loop takes too many turns.
    pub(crate) fn evaluate(
        &self,
        kernel: &Kernel,
        points: usize,
        inputs: &[u32],
    ) -> Result<Vec<u32>, ShaderError> {
        let code = &*self.code;
        let level = SimdLevel::detect();
        let mut results = vec![0; kernel.outputs.len() * points];
        let mut columns = Columns::default();
        columns.prepare(code, 1, BLOCK);
        for start in (0..points).step_by(BLOCK) {
            let count = BLOCK.min(points - start);
            for (column, scalar) in inputs.chunks(points).zip(&kernel.inputs) {
                for (_, register) in code.inputs.iter().filter(|(input, _)| input == scalar) {
                    // Points beyond the last repeat it, so that they end where it does.
                    let words = column[start..start + count].iter();
                    let words = words.chain(std::iter::repeat(&column[start + count - 1]));
                    let cells = columns.column(*register, BLOCK).iter();
                    cells.zip(words).for_each(|(cell, &word)| cell.set(word));
                }
            }
            let ran = run_alone(level, code, &[], &columns, count);
            ran.map_err(|endless| self.text.endless_loop(endless))?;
            for (column, &scalar) in results.chunks_mut(points).zip(&kernel.outputs) {
                let from = columns.operand(code.outputs[scalar as usize], count);
                let words = column[start..start + count].iter_mut().enumerate();
                words.for_each(|(point, word)| *word = from.at(point));
            }
        }
        Ok(results)
    }
}
