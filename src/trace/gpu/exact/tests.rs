//! The routes on any adapter there is: these tests fail without one.

use super::cases::CLASSES;
use super::probe::{Comparison, compare_pairs, compare_triples};
use super::route::Route;
use super::{Module, Refusal, source};
use crate::trace::gpu::kernel::Shape;
use crate::trace::gpu::pages::{Pages, ScenePages};
use crate::trace::gpu::{AdapterChoice, Gpu};

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

const SHAPE: Shape = Shape { stack: 24, members: false, pages: ScenePages::ONE, exact: true, counts: false };

#[test]
fn kernels_are_valid_for_every_shape_and_route() {
    let all = crate::device::FloatControls { rounding: true, subnormals: true, special: true };
    let (two, three) = (Pages { bits: 4, count: 2 }, Pages { bits: 5, count: 3 });
    let paged = ScenePages { nodes: two, pairs: three, identities: two };
    for route in Route::ALL {
        for members in [false, true] {
            for pages in [ScenePages::ONE, paged] {
                let shape = Shape { members, pages, ..SHAPE };
                let words = crate::device::spirv(&source(&shape, route), all, route.fma());
                assert!(words.unwrap_or_else(|error| panic!("{route}: {error}")).len() > 5000);
            }
        }
    }
}

/// The emulated routes are right on every device; whether the fused one is depends on the device.
#[test]
fn emulated_routes_have_the_hosts_bits() {
    let gpu = open();
    let controls = Refusal::unless_possible(&gpu).expect("Vulkan");
    for route in Route::ALL {
        let module = Module::new(&gpu, &source(&SHAPE, route), (route, controls)).expect("a module");
        let probes = module.probes(&gpu).expect("a kernel");
        let triples = compare_triples(&gpu, &probes.fma, 0..100_000).expect("an answer");
        let kernel = module.pairs_probe(&gpu, &probes).expect("a kernel");
        let mut classes = [Comparison::default(); CLASSES.len()];
        let (mut next, step) = (0, 120_000);
        while next < pairs() {
            let end = pairs().min(next + step);
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
