//! `raystream bench shaders`: surfaces and integrators in WGSL beside the same in Rust, and what an operation costs by
//! block size.

mod twins;

use super::Spread;
use super::frame::FrameError;
use raystream::engine::PreparedScene;
use raystream::lanes::SimdLevel;
use raystream::meters::Clock;
use raystream::program::integrator::IntegratorShader;
use raystream::program::shipped::{DUST, WHITTED, WHITTED_SPLIT, WOOD};
use raystream::program::{BsdfShader, PatternShader, ShaderError};
use raystream::render::{HitShading, PathTracer, Settings, WgslShader, Whitted};
use raystream::scene::{
    BlockColumns, BlockSurface, Camera, CodedSurface, ProceduralSurface, ScatteringSurface, Scene, SceneError,
};
use raystream::schedule::{JobOptions, Renderer, Service, TaskKind};
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;
use twins::{Dust, Wood};

/// Blocks of hits that are compared.
const BLOCKS: [usize; 7] = [16, 32, 64, 128, 256, 512, 1024];

/// Lines of the file whose loading is measured.
const LINES: usize = 300;

/// The frame, and how often it is rendered.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Size, samples, depth and seed of the frame. Paths end by depth alone.
    pub settings: Settings,
    /// The camera.
    pub camera: Camera,
    /// Instruction set of the Rust lanes.
    pub simd: SimdLevel,
    /// Rounds.
    pub rounds: usize,
}

/// Results of one surface, of one size of blocks, or of loading.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Name of the row.
    pub configuration: String,
    /// Hits of a block, if the row is about one size.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub block: Option<usize>,
    /// Seconds of a frame, of an operation at 16 points, or of loading.
    pub seconds: Spread,
    /// Thread time of shade tasks for each ray, in nanoseconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shade_ns_per_ray: Option<Spread>,
    /// Shading time divided by that of the same surface or integrator in Rust lanes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shading_ratio: Option<f64>,
    /// The frame's time divided by that of the same surface or integrator in Rust lanes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame_ratio: Option<f64>,
    /// Clock cycles of an operation at 16 points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cycles: Option<f64>,
}

/// Error of measuring shaders.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ShaderBenchError {
    /// A frame failed.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// A shader cannot be loaded.
    #[error(transparent)]
    Shader(#[from] ShaderError),
    /// The scene cannot have the surfaces.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

/// A prepared scene and the service that renders it.
#[derive(Debug, Clone, Copy)]
pub struct Bench<'a> {
    /// The scene with its tree and tracers. All of its materials that do not shine get the surfaces.
    pub prepared: &'a PreparedScene,
    /// The threads.
    pub service: &'a Service,
    /// The frame.
    pub options: Options,
}

/// Way in which a frame is shaded.
enum Shading {
    /// By the path tracer.
    Path,
    /// By Whitted's algorithm in Rust.
    Whitted,
    /// By an integrator in WGSL.
    Wgsl(WgslShader),
}

/// A surface or an integrator to be measured: its name, its number of lanes, and the row that it is compared with.
struct Contender {
    configuration: String,
    prepared: PreparedScene,
    shading: Shading,
    simd: SimdLevel,
    base: usize,
    block: Option<usize>,
}

fn wgsl(name: &str, text: &str) -> Result<Shading, ShaderError> {
    Ok(Shading::Wgsl(IntegratorShader::load(name, text, [])?.into()))
}

fn wood(natives: bool) -> Result<PatternShader, ShaderError> {
    PatternShader::load_with("wood.wgsl", WOOD, [], natives)
}

impl Bench<'_> {
    /// Measures surfaces, operations and loading.
    ///
    /// # Errors
    /// When a frame cannot be rendered.
    pub fn run(&self) -> Result<Vec<Row>, ShaderBenchError> {
        let contenders = self.contenders()?;
        let mut measured: Vec<Vec<(f64, f64)>> = contenders.iter().map(|_| Vec::new()).collect();
        for round in 0..=self.options.rounds {
            for (contender, measured) in contenders.iter().zip(&mut measured) {
                let times = self.frame(contender)?;
                // The first round warms caches and allocates streams.
                if round > 0 {
                    measured.push(times);
                }
            }
        }
        let spreads: Vec<[Spread; 2]> = measured
            .into_iter()
            .map(|times| {
                let (frames, shading): (Vec<f64>, Vec<f64>) = times.into_iter().unzip();
                [Spread::of_times(frames), Spread::of_times(shading)]
            })
            .collect();
        let mut rows: Vec<Row> = Vec::new();
        for (contender, [seconds, shading]) in contenders.iter().zip(&spreads) {
            let [base_seconds, base_shading] = &spreads[contender.base];
            rows.push(Row {
                configuration: contender.configuration.clone(),
                block: contender.block,
                seconds: *seconds,
                shade_ns_per_ray: Some(*shading),
                shading_ratio: Some(shading.median / base_shading.median),
                frame_ratio: Some(seconds.median / base_seconds.median),
                cycles: None,
            });
        }
        rows.extend(self.operations()?);
        rows.push(self.loading()?);
        Ok(rows)
    }

    fn contenders(&self) -> Result<Vec<Contender>, ShaderBenchError> {
        let simd = self.options.simd;
        let mut all = Vec::new();
        let mut add = |configuration: &str, surface: CodedSurface, simd, base, block| {
            let prepared = self.prepared.with_scene(self.scene(surface))?;
            let (configuration, shading) = (configuration.into(), Shading::Path);
            all.push(Contender { configuration, prepared, shading, simd, base, block });
            Ok::<_, SceneError>(())
        };
        let rust = || ProceduralSurface::new(Wood { rings: 3.0 });
        add("wood, Rust in lanes", rust().into(), simd, 0, None)?;
        add("wood, Rust in one lane", rust().into(), SimdLevel::Scalar, 0, None)?;
        add("wood, WGSL", ProceduralSurface::from(wood(true)?).into(), simd, 0, None)?;
        add("wood, WGSL, noise written out", ProceduralSurface::from(wood(false)?).into(), simd, 0, None)?;
        let dust = || ScatteringSurface::new(Dust { albedo: 0.9 });
        add("dust, Rust in lanes", dust().into(), simd, 4, None)?;
        add("dust, Rust in one lane", dust().into(), SimdLevel::Scalar, 4, None)?;
        let shader = BsdfShader::load("dust.wgsl", DUST, [])?;
        add("dust, WGSL", ScatteringSurface::from(shader).into(), simd, 4, None)?;
        for block in BLOCKS {
            let shader = wood(true)?.with_block(Some(block));
            add("wood, WGSL, by block", ProceduralSurface::from(shader).into(), simd, 0, Some(block))?;
        }
        let base = all.len();
        let whitted = [
            ("Whitted, Rust in lanes", Shading::Whitted),
            ("Whitted, WGSL, split by hand", wgsl("whitted_split.wgsl", WHITTED_SPLIT)?),
            ("Whitted, WGSL, recursive", wgsl("whitted.wgsl", WHITTED)?),
        ];
        for (configuration, shading) in whitted {
            let (configuration, prepared) = (configuration.into(), self.prepared.clone());
            all.push(Contender { configuration, prepared, shading, simd, base, block: None });
        }
        Ok(all)
    }

    /// The scene with a surface on everything that does not shine.
    fn scene(&self, surface: CodedSurface) -> Arc<Scene> {
        let mut scene = Scene::clone(&self.prepared.scene);
        let surface = scene.add_surface(surface);
        for material in scene.materials.iter_mut().filter(|material| material.emission.is_none()) {
            (material.surface, material.normal_map) = (surface, None);
        }
        Arc::new(scene)
    }

    /// Seconds of a frame, and nanoseconds of shading for each ray.
    fn frame(&self, contender: &Contender) -> Result<(f64, f64), FrameError> {
        let Options { settings, camera, .. } = self.options;
        let (lit, simd) = (contender.prepared.lit(), contender.simd);
        match &contender.shading {
            Shading::Path => {
                let path = PathTracer::new(lit, &camera, settings, None)?.with_simd(simd);
                self.time(contender, path)
            }
            Shading::Whitted => self.time(contender, Whitted::new(lit, &camera, settings)?.with_simd(simd)),
            Shading::Wgsl(shader) => {
                let integrator = HitShading::of(shader.clone(), lit, &camera, settings)?;
                self.time(contender, integrator.with_simd(simd))
            }
        }
    }

    fn time(
        &self,
        contender: &Contender,
        renderer: impl Renderer + 'static,
    ) -> Result<(f64, f64), FrameError> {
        let options = JobOptions::default().with_timeline(true);
        let started = Instant::now();
        let report = contender.prepared.submit(self.service, Arc::new(renderer), options)?.wait();
        let seconds = started.elapsed().as_secs_f64();
        let report = report.map_err(|error| FrameError::Job { configuration: "a frame", error })?;
        let shading = report.timeline.iter().filter(|task| task.kind == TaskKind::Shade);
        let shade_ns: u64 = shading.map(|task| task.end_ns - task.start_ns).sum();
        Ok((seconds, shade_ns as f64 / report.rays.total() as f64))
    }

    /// Cost of an operation at 16 points, by the size of blocks: wood with its noise written out.
    fn operations(&self) -> Result<Vec<Row>, ShaderError> {
        let mhz = Clock::find().and_then(|clock| clock.mhz());
        let mut rows = Vec::new();
        for block in BLOCKS {
            let shader = wood(false)?.with_block(Some(block));
            let (mut points, mut finishes) = (BlockColumns::default(), BlockColumns::default());
            points.for_points(shader.wanted(), block);
            finishes.for_finishes(block);
            for (i, x) in points.column_mut(0).iter_mut().enumerate() {
                *x = i as f32 * 0.37;
            }
            let lanes = if self.options.simd == SimdLevel::Avx512 { 16 } else { 8 };
            let turns = (1 << 14) / block;
            let mut compute = || {
                let started = Instant::now();
                for _ in 0..turns {
                    shader.compute(lanes, block, &points, &mut finishes);
                }
                let each = (shader.operations() * turns * block / 16) as f64;
                started.elapsed().as_secs_f64() / each
            };
            compute();
            let seconds = Spread::of_times((0..self.options.rounds.max(1)).map(|_| compute()).collect());
            rows.push(Row {
                configuration: "an operation at 16 points".into(),
                block: Some(block),
                cycles: mhz.map(|mhz| seconds.median * mhz * 1e6),
                seconds,
                shade_ns_per_ray: None,
                shading_ratio: None,
                frame_ratio: None,
            });
        }
        Ok(rows)
    }

    /// Time to parse, validate and lower a file.
    fn loading(&self) -> Result<Row, ShaderError> {
        let mut text = String::from(WOOD);
        let mut lines = text.lines().count();
        let mut number = 0;
        while lines + 6 <= LINES {
            text += &format!(
                "fn more{number}(p: vec3f) -> f32 {{\n    let q = p * {}.5;\n    let r = noise(q) * 0.5;\n    \
                 return r + noise(q.zxy);\n}}\n\n",
                number + 1
            );
            (lines, number) = (lines + 6, number + 1);
        }
        let mut times = Vec::new();
        for _ in 0..=self.options.rounds {
            let started = Instant::now();
            PatternShader::load("wood.wgsl", &text, [])?;
            times.push(started.elapsed().as_secs_f64());
        }
        Ok(Row {
            configuration: format!("loading {lines} lines"),
            block: None,
            seconds: Spread::of_times(times.split_off(1)),
            shade_ns_per_ray: None,
            shading_ratio: None,
            frame_ratio: None,
            cycles: None,
        })
    }
}
