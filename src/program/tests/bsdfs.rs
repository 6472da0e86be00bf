//! BSDFs as surfaces.

use super::patterns::point_at;
use crate::lanes::{Num, SingleLane, Vector};
use crate::program::BsdfShader;
use crate::scene::{Scattered, Scattering, Scene};

const COUNTING: &str = "
    var<private> count: f32 = 1.0;
    struct State { left: f32, position: vec3f }
    fn prepare(at: Point) -> State {
        count += at.position.x;
        if (at.position.y > 0.0) { return State(count, at.position); }
        return State(-count, at.position);
    }
    fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe {
        count *= 2.0;
        return Lobe(vec3f(s.left, count, s.position.z), wo.z + 10.0 * wi.z);
    }
    fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered {
        count += u;
        return Scattered(vec3f(u2, wo.x), vec3f(s.left, count, s.position.y), s.position.z);
    }";

#[test]
fn functions_get_their_arguments_and_begin_with_the_initial_values_of_variables() {
    let shader = BsdfShader::load("counting.wgsl", COUNTING, []).unwrap_or_else(|error| panic!("{error}"));
    let (scene, l) = (Scene::default(), SingleLane::default());
    let n = |x: f32| Num::splat(l, x);
    let numbers = |v: Vector<SingleLane>| [v.x, v.y, v.z].map(Num::get);
    let (wo, wi) = (Vector::new(n(0.25), n(0.5), n(0.75)), Vector::new(n(2.0), n(3.0), n(4.0)));
    for (position, left) in [([4.0, 6.0, 7.0], 5.0), ([8.0, -6.0, 7.0], -9.0)] {
        let at = point_at(&scene, position);
        let (value, pdf) = shader.evaluate(&at, wo, wi);
        assert_eq!((numbers(value), pdf.get()), ([left, 2.0, 7.0], 40.75));
        let Scattered { wi, weight, pdf } = shader.sample(&at, wo, n(0.125), [n(0.375), n(0.625)]);
        assert_eq!(numbers(wi), [0.375, 0.625, 0.25]);
        assert_eq!((numbers(weight), pdf.get()), ([left, 1.125, position[1]], 7.0));
    }
}
