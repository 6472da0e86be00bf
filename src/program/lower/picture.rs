//! Pictures: variables of textures, and the calls that look them up.

use super::shape::unsupported;
use super::{Lowerer, PointMask, Scalar, Value};
use crate::program::code::{Instruction, Register};
use crate::program::kernel::first_scalar;
use crate::program::parameter::is_picture;
use crate::program::source::Fault;
use crate::scene::POINT_FIELDS;
use naga::{AddressSpace, GlobalVariable, Handle, Span, TypeInner};
use std::rc::Rc;

/// The functions of the prelude: the second is given the side of the square that is averaged.
pub(super) const FUNCTIONS: [&str; 2] = ["image", "image_over"];

/// A look-up that has the same results at the same points.
pub(super) struct LookedUp {
    picture: u32,
    operands: [Scalar; 5],
    mask: PointMask,
    results: Rc<[Scalar]>,
}

impl Lowerer<'_> {
    /// Makes a variable of a module a picture. False if it is a variable of numbers.
    ///
    /// # Errors
    /// When it is neither, or there are no pictures here.
    pub(super) fn declare_picture(
        &mut self,
        handle: Handle<GlobalVariable>,
        variable: &GlobalVariable,
    ) -> Result<bool, Fault> {
        if variable.space == AddressSpace::Private {
            return Ok(false);
        }
        let module = self.input.module;
        let span = module.global_variables.get_span(handle);
        if self.input.host.is_some() {
            return Err(Fault::new(
                span,
                "an integrator looks up no pictures",
                "look it up in a pattern or a BSDF: `bsdf_evaluate` and `at.colour` know what it says there",
            ));
        }
        if is_picture(module, variable) {
            let number = self.pictures.len() as u32;
            self.pictures.entry(handle).or_insert(number);
            return Ok(true);
        }
        let (message, remedy) = match module.types[variable.ty].inner {
            TypeInner::Sampler { .. } => (
                "pictures need no sampler",
                "leave it out and write `image(picture, uv)`; a picture's binding says how it continues beyond its \
                 edges",
            ),
            TypeInner::Image { .. } => {
                ("there are no textures of this type", "a picture is `var name: texture_2d<f32>;`")
            }
            _ => (
                "programs have no buffers",
                "pass numbers as `override`s; variables of a module are `var<private>`",
            ),
        };
        Err(Fault::new(span, message, remedy))
    }

    /// A call of one of [`FUNCTIONS`].
    pub(super) fn call_image(&mut self, values: &[Value]) -> Result<Rc<[Scalar]>, Fault> {
        let (picture, place, width) = match values {
            [Value::Picture(picture), Value::Scalars(place)] => (*picture, place, None),
            [Value::Picture(picture), Value::Scalars(place), Value::Scalars(width)] => {
                (*picture, place, Some(width[0]))
            }
            _ => return Err(unsupported("pictures that are chosen while they run")),
        };
        let place = [place[0], place[1]];
        let width = width.unwrap_or_else(|| self.covered(place));
        let hit = first_scalar(POINT_FIELDS, "barycentric");
        let [second, third] = [hit, hit + 1].map(|scalar| self.point_scalar(scalar));
        let operands = [place[0], place[1], width, second, third];
        let is_same =
            |one: &&LookedUp| (one.picture, one.operands, one.mask) == (picture, operands, self.mask);
        if let Some(known) = self.looked_up.iter().find(is_same) {
            return Ok(Rc::clone(&known.results));
        }
        let start = self.code.lists.len() as u32;
        let columns = operands.map(|scalar| self.column(scalar));
        self.code.lists.extend(columns);
        let end = self.code.lists.len() as u32;
        let to: [Register; 4] = [(); 4].map(|()| self.register());
        self.code.lists.extend(to);
        self.code.instructions.push(Instruction::LookUp {
            picture,
            operands: start..end,
            results: end..self.code.lists.len() as u32,
        });
        let results: Rc<[Scalar]> = to.into_iter().map(Scalar::Column).collect();
        let mask = self.mask;
        self.looked_up.push(LookedUp { picture, operands, mask, results: Rc::clone(&results) });
        Ok(results)
    }

    /// The fault of a picture that is used as if it were a value.
    pub(super) fn no_value() -> Fault {
        Fault::new(
            Span::UNDEFINED,
            "a picture is no value",
            "look it up: `image(picture, uv)` is its red, green, blue and alpha",
        )
    }
}
