//! The routes on any adapter there is: these tests fail without one.

use super::cases::CLASSES;
use super::probe::{Comparison, compare_pairs, compare_triples};
use super::route::Route;
use super::{Form, Module, Refusal, source};
use crate::device::{AdapterChoice, Checks, FloatControls, Gpu, spirv};
use crate::trace::gpu::kernel::{Shape, Sides};
use crate::trace::gpu::pages::{Pages, ScenePages};

/// Opens an adapter, a software one if there is no other.
fn open() -> Gpu {
    let choice = AdapterChoice { name: None, allow_software: true };
    Gpu::open(&choice).expect("tests need a GPU; a software adapter will do")
}

/// Pairs of each route: few here, 10⁷ in the long run (`scripts/soak`).
fn pairs() -> u32 {
    let asked = std::env::var("RAYSTREAM_EXACT_PAIRS").ok();
    asked.map_or(120_000, |text| text.parse().expect("a number of pairs"))
}

const SHAPE: Shape = Shape { stack: 24, members: false, pages: ScenePages::ONE, counts: false, alpha: false };

/// Forms by a route.
fn forms(route: Route) -> impl Iterator<Item = Form> {
    let sides = [Sides::WithinMargins, Sides::Exact].into_iter();
    sides.flat_map(move |sides| [false, true].map(|flushes| Form { route, sides, flushes }))
}

#[test]
fn kernels_are_valid_for_every_shape_and_form() {
    let all = FloatControls { rounding: true, subnormals: true, special: true };
    let (two, three) = (Pages { bits: 4, count: 2 }, Pages { bits: 5, count: 3 });
    let paged = ScenePages { nodes: two, pairs: three, identities: two };
    for form in Route::ALL.into_iter().flat_map(forms) {
        for [members, alpha] in [[false, false], [true, false], [true, true]] {
            for pages in [ScenePages::ONE, paged] {
                let shape = Shape { members, pages, alpha, ..SHAPE };
                let words = spirv(&source(&shape, form), None, all, form.route.fma(), Checks::Proven);
                assert!(words.unwrap_or_else(|error| panic!("{form:?}: {error}")).len() > 5000);
            }
        }
    }
}

#[test]
fn only_a_fused_device_that_keeps_subnormal_numbers_rejects_triangles_without_margins() {
    let none = FloatControls::default();
    let keeps = FloatControls { subnormals: true, ..none };
    let fused = Form { route: Route::Fused, sides: Sides::Exact, flushes: false };
    assert_eq!(Form::of(Route::Fused, keeps), fused);
    assert_eq!(Form::of(Route::Fused, none), Form { sides: Sides::WithinMargins, flushes: true, ..fused });
    assert_eq!(Form::of(Route::Integers, keeps).sides, Sides::WithinMargins);
}

/// The emulated routes are right on every device. Whether the fused one is depends on the device, and few pairs show
/// it.
#[test]
fn emulated_routes_have_the_hosts_bits() {
    let gpu = open();
    let controls = Refusal::unless_possible(&gpu).expect("Vulkan");
    for route in Route::ALL {
        let form = Form { route, sides: Sides::WithinMargins, flushes: true };
        let module = Module { source: source(&SHAPE, form), route, controls };
        let kernel = module.probe(&gpu, "probe_fma").expect("a kernel");
        let triples = compare_triples(&gpu, &kernel, 0..100_000).expect("an answer");
        let kernel = module.probe(&gpu, "probe_pairs").expect("a kernel");
        let mut classes = [Comparison::default(); CLASSES.len()];
        let (mut next, step) = (0, 120_000);
        let count = if route == Route::Fused { step.min(pairs()) } else { pairs() };
        while next < count {
            let end = count.min(next + step);
            let found = compare_pairs(&gpu, &kernel, next..end).expect("an answer");
            for (sum, class) in classes.iter_mut().zip(found) {
                sum.cases += class.cases;
                sum.wrong += class.wrong;
                sum.undecided += class.undecided;
            }
            next = end;
        }
        println!("{route}: triples {triples:?}");
        for (name, class) in CLASSES.iter().zip(&classes) {
            println!("    {name}: {class:?}");
            assert!(route == Route::Fused || class.wrong == 0, "{route}, {name}: {class:?}");
        }
        assert!(route == Route::Fused || triples.wrong == 0, "{route}: {triples:?}");
        let ordinary = classes[0];
        assert!(ordinary.undecided == 0 && ordinary.cases > 0, "{route}: {ordinary:?}");
    }
}
