//! Patterns and BSDFs in WGSL on the GPU: the bits that the CPU computed at the hits of a picture.

use super::shared;
use raystream::engine::{PreparedScene, Units};
use raystream::lanes::{Int, Lanes, MAX_LANES, Mask, Num, Vector};
use raystream::program::gpu::GpuProgram;
use raystream::program::{BsdfShader, PatternShader};
use raystream::render::Settings;
use raystream::scene::{
    Camera, FINISH_FIELDS, Finish, POINT_FIELDS, Points, Procedural, ProceduralSurface, Scattered,
    Scattering, ScatteringSurface, Scene, load,
};
use raystream::schedule::{JobOptions, Service, ServiceOptions};
use std::fmt::{Debug, Formatter};
use std::path::Path;
use std::sync::{Arc, Mutex};

/// A hit at which a surface was computed.
struct Row {
    /// All scalars of the point, then what a BSDF was asked.
    asked: Vec<u32>,
    /// The first scalar of the answer.
    first: usize,
    answered: Vec<u32>,
}

/// A surface that notes what it is asked and what it answers.
struct Noting<S> {
    surface: Arc<S>,
    rows: Arc<Mutex<Vec<Row>>>,
}

impl<S: Debug> Debug for Noting<S> {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        self.surface.fmt(f)
    }
}

impl<S> Noting<S> {
    fn new(surface: S) -> (Self, Arc<S>, Arc<Mutex<Vec<Row>>>) {
        let (surface, rows) = (Arc::new(surface), Arc::default());
        (Self { surface: Arc::clone(&surface), rows: Arc::clone(&rows) }, surface, rows)
    }

    fn note<L: Lanes>(&self, asked: &[Int<L>], first: usize, answered: &[Num<L>]) {
        let columns = |words: Vec<Int<L>>| -> Vec<[u32; MAX_LANES]> {
            let column = |word: Int<L>| {
                let mut column = [0; MAX_LANES];
                word.store(&mut column);
                column
            };
            words.into_iter().map(column).collect()
        };
        let asked = columns(asked.to_vec());
        let answered = columns(answered.iter().map(|number| number.to_bits()).collect());
        let of =
            |columns: &[[u32; MAX_LANES]], lane: usize| columns.iter().map(|column| column[lane]).collect();
        let row = |lane| Row { asked: of(&asked, lane), first, answered: of(&answered, lane) };
        self.rows.lock().expect("no panic").extend((0..L::LANES).map(row));
    }
}

fn vector<L: Lanes>(v: Vector<L>) -> [Int<L>; 3] {
    [v.x, v.y, v.z].map(Num::to_bits)
}

/// The scalars of points, in the order of `POINT_FIELDS`.
fn point<L: Lanes>(at: &Points<'_, L>) -> Vec<Int<L>> {
    let l = at.lanes();
    let truth = |of: Mask<L>| Int::select(of, Int::splat(l, u32::MAX), Int::splat(l, 0));
    let mut scalars: Vec<Int<L>> =
        [at.position, at.normal, at.geometric_normal, at.wo].into_iter().flat_map(vector).collect();
    scalars.extend(
        [at.uv[0], at.uv[1], at.barycentric[0], at.barycentric[1], at.width, at.area].map(Num::to_bits),
    );
    scalars.extend([at.primitive, truth(at.front)]);
    scalars.extend(vector(at.tangent()).into_iter().chain(vector(at.bitangent())));
    scalars.push(at.footprint().to_bits());
    scalars.extend(vector(at.vertex_colour()));
    scalars.extend([at.vertex_alpha().to_bits(), at.object()]);
    scalars.extend(at.uv1().map(Num::to_bits));
    scalars.extend(vector(at.object_position()));
    scalars.extend([at.footprint1(), at.object_width()].map(Num::to_bits));
    scalars.extend(vector(at.object_bounds_min()).into_iter().chain(vector(at.object_bounds_max())));
    scalars.extend([at.time().to_bits(), at.frame(), truth(at.outside())]);
    scalars.extend(at.uv2().into_iter().chain(at.uv3()).map(Num::to_bits));
    scalars.extend([at.footprint2(), at.footprint3()].map(Num::to_bits));
    assert_eq!(scalars.len(), POINT_FIELDS.iter().map(|field| field.kind.numbers()).sum::<usize>());
    scalars
}

impl Procedural for Noting<PatternShader> {
    fn effects(&self) -> raystream::scene::Effects {
        self.surface.effects()
    }

    fn finish<L: Lanes>(&self, at: &Points<L>) -> Finish<L> {
        let finish = self.surface.finish(at);
        let f = &finish;
        let three = |v: Vector<L>| [v.x, v.y, v.z];
        // In the order of `FINISH_FIELDS`.
        let scalars = [
            &three(f.colour)[..],
            &[f.metallic, f.roughness, f.clearcoat, f.transmission],
            &three(f.emission),
            &[f.opacity],
            &three(f.normal),
            &[f.specular],
            &three(f.specular_tint),
            &[f.reflectance, f.clearcoat_roughness, f.anisotropy],
            &three(f.rough_direction),
            &three(f.sheen),
            &[f.sheen_roughness, f.film, f.film_thickness, f.film_ior, f.diffuse_transmission],
            &three(f.diffuse_transmission_colour),
        ]
        .concat();
        assert_eq!(scalars.len(), FINISH_FIELDS.iter().map(|field| field.kind.numbers()).sum::<usize>());
        self.note(&point(at), 0, &scalars);
        finish
    }
}

impl Scattering for Noting<BsdfShader> {
    fn transmits(&self) -> bool {
        self.surface.transmits()
    }

    fn evaluate<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let (value, pdf) = self.surface.evaluate(at, wo, wi);
        // Not the centre of the disk, where the host has to decide.
        let random = [0.5, 0.2, 0.7].map(|u| Num::splat(at.lanes(), u).to_bits());
        let asked = [point(at), vector(wo).into(), vector(wi).into(), random.into()].concat();
        self.note(&asked, 0, &[value.x, value.y, value.z, pdf]);
        (value, pdf)
    }

    fn sample<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, u: Num<L>, u2: [Num<L>; 2]) -> Scattered<L> {
        let sample = self.surface.sample(at, wo, u, u2);
        let random = [u, u2[0], u2[1]].map(Num::to_bits);
        // The light's direction may be any.
        let asked = [point(at), vector(wo).into(), vector(wo).into(), random.into()].concat();
        let Scattered { wi, weight, pdf } = sample;
        self.note(&asked, 4, &[wi.x, wi.y, wi.z, weight.x, weight.y, weight.z, pdf]);
        sample
    }
}

/// Renders the Cornell box with a surface on its white walls.
fn render(replace: impl FnOnce(&mut Scene)) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut scene = load::load(root.join("scenes/cornell.json")).expect("scene");
    replace(&mut scene);
    let prepared = PreparedScene::new(scene, &Units::cpu()).expect("a valid scene");
    let camera = prepared.scene.camera.unwrap_or_else(|| Camera::framing(&prepared.scene.bounds(), 1.0));
    let settings = Settings::new(40, 40).with_spp(4).with_max_bounces(2);
    let path = prepared.path(&camera, settings).expect("settings");
    let service = Service::new(ServiceOptions::default().with_host_threads(2)).expect("threads");
    prepared.submit(&service, path, JobOptions::default()).expect("job").wait().expect("frame");
}

/// Compares the device's answers with those that the host gave.
fn compare(name: &str, compiled: &GpuProgram, rows: &Mutex<Vec<Row>>) {
    let rows = rows.lock().expect("no panic");
    assert!(rows.len() > 5000, "{name} was computed at {} hits", rows.len());
    let column = |&scalar: &u32| rows.iter().map(move |row| row.asked[scalar as usize]);
    let inputs: Vec<u32> = compiled.inputs().iter().flat_map(column).collect();
    let answers = compiled.evaluate(rows.len(), &inputs).unwrap_or_else(|error| panic!("{name}: {error}"));
    let mut compared = 0;
    for (&scalar, column) in compiled.outputs().iter().zip(answers.chunks(rows.len())) {
        for (row, &word) in rows.iter().zip(column) {
            let Some(place) = (scalar as usize).checked_sub(row.first) else { continue };
            let Some(&answered) = row.answered.get(place) else { continue };
            assert_eq!(word, answered, "{name}: scalar {scalar} at {:x?}", row.asked);
            compared += 1;
        }
    }
    let report = compiled.report();
    // What comes near subnormal numbers is the host's on a device that flushes them.
    let parts = if compiled.flushes() { 2 } else { 20 };
    assert!(compared > 2 * rows.len() && report.undecided * parts < report.points, "{name}: {report:?}");
}

fn source(file: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/shaders").join(file);
    std::fs::read_to_string(path).expect("a shader")
}

/// Compares a pattern on the walls of a picture.
fn compare_pattern(name: &str, text: &str) {
    let gpu = shared();
    let (noting, shader, rows) = Noting::new(PatternShader::load(name, text, []).expect("valid"));
    render(|scene| {
        assert!(scene.replace_surface("white", ProceduralSurface::new(noting)).expect("walls") > 0)
    });
    compare(name, &GpuProgram::of_pattern(&gpu, &shader).expect("a kernel"), &rows);
}

#[test]
fn patterns_of_noise_have_the_bits_of_the_cpu_at_every_hit_of_a_picture() {
    for file in ["wood.wgsl", "marble.wgsl"] {
        compare_pattern(file, &source(file));
    }
}

#[test]
fn a_pattern_has_the_bits_of_the_cpu_at_every_hit_of_a_picture() {
    compare_pattern(
        "tiles.wgsl",
        "fn pattern(at: Point) -> Finish {
            let place = at.position.xz * 5.0 + 0.05 * at.position.y;
            let tile = floor(place);
            let inside = abs(fract(place) - 0.5);
            let joint = smoothstep(0.46, 0.48, max(inside.x, inside.y));
            var finish = matte(at);
            for (var turn = 0u; turn < 3u; turn++) {
                finish.colour[turn] = 0.5 + 0.4 * sin(dot(tile, vec2f(1.7, f32(turn) + 0.3)));
            }
            if (joint > 0.5) { finish.colour = sqrt(finish.colour) / (1.0 + length(place)); }
            finish.roughness = mix(exp2(-2.0 - inside.x), 1.0, joint) * (0.5 + 0.5 * noise(3.0 * at.position));
            finish.normal = normalize(at.normal + 0.1 * vec3f(inside.x, 0.0, inside.y));
            return finish;
        }",
    );
}

#[test]
fn a_bsdf_has_the_bits_of_the_cpu_at_every_hit_of_a_picture() {
    let gpu = shared();
    for file in ["velvet.wgsl", "dust.wgsl"] {
        let (noting, shader, rows) = Noting::new(BsdfShader::load(file, &source(file), []).expect("valid"));
        render(|scene| {
            assert!(scene.replace_surface("white", ScatteringSurface::new(noting)).expect("walls") > 0)
        });
        compare(file, &GpuProgram::of_bsdf(&gpu, &shader).expect("a kernel"), &rows);
    }
}
