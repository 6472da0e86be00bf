//! The class `Scene`, and what a scene may be given as.

use crate::arrays::{array, leading, numbers};
use crate::calls::Given;
use crate::guarded::Guarded;
use crate::material::{Described, Material};
use crate::mesh::{Geometry, Mesh, checked};
use crate::threads::Threads;
use crate::world::matrices;
use glam::{DMat4, Vec2, Vec3, Vec4};
use numpy::{PyArray, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyKeyError, PyMemoryError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};
use raystream::memory::MemoryBudget;
use raystream::scene::{self, Assembly, AssemblyError, Part, Shared, TriangleMesh, VertexAttribute};
use std::sync::Arc;

/// Named objects with what they look like, to be rendered.
///
/// `Scene()` is empty, and `add` adds objects. With arguments, which are those of `add`, it has one object from the
/// beginning, by default of the name "mesh".
///
/// >>> import raystream as rs
/// >>> scene = rs.Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], colours=[[1, 0, 0], [0, 1, 0], [0, 0, 1]])
/// >>> rs.render(scene, size=(32, 32), spp=4).image.shape
/// (32, 32, 3)
#[pyclass(module = "raystream", frozen)]
#[derive(Debug)]
pub struct Scene {
    state: Guarded<State>,
}

/// The objects so far. Clones share their arrays.
#[derive(Clone, Debug, Default)]
struct State {
    assembly: Arc<Assembly>,
    /// What the assembly's materials were given as, by number.
    materials: Arc<Vec<Arc<Described>>>,
    /// The scene of these objects, once it has been asked for.
    built: Option<scene::Scene>,
    changes: u64,
}

impl State {
    fn add(&mut self, part: Part, material: Option<Arc<Described>>) -> Result<(), AssemblyError> {
        let assembly = Arc::make_mut(&mut self.assembly);
        let known =
            |material: &Arc<Described>| self.materials.iter().position(|of| Arc::ptr_eq(of, material));
        match material {
            None => assembly.add(part)?,
            Some(material) => match known(&material) {
                Some(number) => assembly.add(Part { material: Some(number as u32), ..part })?,
                None => {
                    let Described { name, recipe, textures, .. } = &*material;
                    assembly.add_with_recipe(part, name, recipe, textures)?;
                    Arc::make_mut(&mut self.materials).push(material);
                }
            },
        }
        (self.built, self.changes) = (None, self.changes + 1);
        Ok(())
    }
}

/// What is wrong with an object or a material, as Python's error.
pub fn refused(error: &AssemblyError) -> PyErr {
    match error {
        AssemblyError::Memory(error) => PyMemoryError::new_err(error.to_string()),
        error => PyValueError::new_err(error.to_string()),
    }
}

/// What vertices have beside their positions.
struct Attributes<'a, 'py> {
    normals: Given<'a, 'py>,
    colours: Given<'a, 'py>,
    uvs: Given<'a, 'py>,
    /// Those with names of their own, in a dictionary.
    named: Given<'a, 'py>,
}

/// State of a scene in a pickle: its materials, and for each object keywords of `add` and the number of its material.
type Pickled<'py> = (Vec<Py<Material>>, Vec<(Bound<'py, PyDict>, Option<usize>)>);

#[pymethods]
impl Scene {
    #[new]
    #[pyo3(signature = (
        vertices=None, faces=None, *, name="mesh", material=None, transform=None, normals=None, colours=None, uvs=None,
        attributes=None
    ))]
    #[expect(clippy::too_many_arguments, reason = "Python has keywords")]
    fn new(
        py: Python<'_>,
        vertices: Given<'_, '_>,
        faces: Given<'_, '_>,
        name: &str,
        material: Given<'_, '_>,
        transform: Given<'_, '_>,
        normals: Given<'_, '_>,
        colours: Given<'_, '_>,
        uvs: Given<'_, '_>,
        attributes: Given<'_, '_>,
    ) -> PyResult<Self> {
        let scene = Self { state: Guarded::new(State::default()) };
        match vertices {
            Some(vertices) => {
                let name = Some(name);
                scene
                    .add(py, vertices, faces, name, material, transform, normals, colours, uvs, attributes)?;
            }
            None if [faces, material, transform, normals, colours, uvs, attributes]
                .iter()
                .any(Option::is_some) =>
            {
                return Err(PyValueError::new_err("an object needs vertices; Scene() alone is empty"));
            }
            None => {}
        }
        Ok(scene)
    }

    /// Adds an object under a name of its own, by default "object" with its number.
    ///
    /// `vertices` are `(v, 3)` numbers, `faces` `(f, 3)` integers, rows of `vertices`; without faces, `vertices` are
    /// the corners of triangles, `(f, 3, 3)`, or a `Mesh`. `material` is a `Material`, which several objects may
    /// share, or a dictionary of its values, whose name is then the object's; without one it is matte, grey or of the
    /// colours, and named "default". `transform` moves the object, `(4, 4)` or `(3, 4)`; `(n, 4, 4)` shows it n
    /// times: layers name the instances NAME/0, NAME/1 and so on.
    ///
    /// `normals`, `(v, 3)`, are interpolated (flat triangles without them; 0 for a vertex that has none); `colours`,
    /// `(v, 3)` or `(v, 4)`, linear, 0 to 1, multiply the material's colour and, if there is a fourth column, its
    /// alpha; `uvs`, `(v, 2)` or several sets of them, `(n, v, 2)`, are where textures lie and what shaders and the
    /// layer uv see, with (0, 0) at the first row of an image; `attributes`, a dictionary of arrays `(v,)` or `(v, n)`
    /// with n from 1 to 4, are what a shader's `struct Attributes` reads by these names. All are stored in float32.
    ///
    /// ValueError names the object and the first vertex, face or number that is wrong; a scene that does not fit in
    /// memory raises MemoryError. The scene is then as it was.
    ///
    /// >>> import raystream as rs
    /// >>> scene = rs.Scene()
    /// >>> steel = rs.Material("steel", colour=[0.6, 0.6, 0.6], metallic=1, roughness=0.3)
    /// >>> plate = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    /// >>> scene.add(plate, [[0, 1, 2]], name="plate", material=steel)
    /// >>> scene.add(plate, [[0, 1, 2]], name="lamp", material={"emission": [5, 5, 5]},
    /// ...           transform=[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -2]])
    /// >>> scene.objects, scene.materials
    /// (['plate', 'lamp'], ['steel', 'lamp'])
    #[pyo3(signature = (
        vertices, faces=None, *, name=None, material=None, transform=None, normals=None, colours=None, uvs=None,
        attributes=None
    ))]
    #[expect(clippy::too_many_arguments, reason = "Python has keywords")]
    fn add(
        &self,
        py: Python<'_>,
        vertices: &Bound<'_, PyAny>,
        faces: Given<'_, '_>,
        name: Option<&str>,
        material: Given<'_, '_>,
        transform: Given<'_, '_>,
        normals: Given<'_, '_>,
        colours: Given<'_, '_>,
        uvs: Given<'_, '_>,
        attributes: Given<'_, '_>,
    ) -> PyResult<()> {
        let numbered = || Ok::<_, PyErr>(format!("object {}", self.state.now()?.assembly.parts().len()));
        let name = name.map_or_else(numbered, |name| Ok(name.to_owned()))?;
        let material = material.map(|given| Material::read(given, &name)).transpose()?;
        let transforms = transform.map_or(Ok(vec![DMat4::IDENTITY]), matrices)?;
        let mut mesh = mesh_of(vertices, faces, &Attributes { normals, colours, uvs, named: attributes })?;
        let threads = Threads::all()?;
        threads.run(py, || mesh.normalise_normals());
        self.insert(py, Part { transforms, ..Part::new(name, mesh) }, material)
    }

    /// The names of the objects, in their order.
    #[getter]
    fn objects(&self) -> PyResult<Vec<String>> {
        Ok(self.state.now()?.assembly.parts().iter().map(|part| part.name.clone()).collect())
    }

    /// The names of the materials that were given, in their order: those that the option `material` takes. Objects
    /// without one have the material "default".
    #[getter]
    fn materials(&self) -> PyResult<Vec<String>> {
        Ok(self.state.now()?.materials.iter().map(|material| material.name.clone()).collect())
    }

    /// Number of triangles, those of all instances.
    #[getter]
    fn triangle_count(&self) -> PyResult<u64> {
        Ok(self.state.now()?.assembly.triangle_count())
    }

    /// The corners of the box around all triangles, float32 `(2, 3)`: the least and the greatest coordinates.
    #[getter]
    fn bounds<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let bounds = self.scene(py)?.bounds();
        array(py, [bounds.min.to_array(), bounds.max.to_array()].concat(), &[2], 3)
    }

    fn __len__(&self) -> PyResult<usize> {
        Ok(self.state.now()?.assembly.parts().len())
    }

    fn __copy__(&self) -> PyResult<Self> {
        Ok(Self { state: Guarded::new(self.state.now()?) })
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.__copy__()
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let (py, state) = (slf.py(), slf.get().state.now()?);
        let (materials, objects) = (PyList::empty(py), PyList::empty(py));
        for material in &*state.materials {
            materials.append(Py::new(py, Material::of(material.clone()))?)?;
        }
        for part in state.assembly.parts() {
            objects.append((keywords_of(py, part)?, part.material))?;
        }
        let state = PyTuple::new(py, [materials, objects])?;
        PyTuple::new(py, [slf.get_type().into_any(), PyTuple::empty(py).into_any(), state.into_any()])
    }

    fn __setstate__(&self, py: Python<'_>, state: Pickled<'_>) -> PyResult<()> {
        let (materials, objects) = state;
        for (keywords, material) in objects {
            let of = |name: &str| -> PyResult<Option<Bound<'_, PyAny>>> { keywords.get_item(name) };
            let required = |name: &str| of(name)?.ok_or_else(|| PyKeyError::new_err(name.to_owned()));
            let [normals, colours, uvs, named] =
                [of("normals")?, of("colours")?, of("uvs")?, of("attributes")?];
            let attributes = Attributes {
                normals: normals.as_ref(),
                colours: colours.as_ref(),
                uvs: uvs.as_ref(),
                named: named.as_ref(),
            };
            let mesh = mesh_of(&required("vertices")?, of("faces")?.as_ref(), &attributes)?;
            let transforms = matrices(&required("transform")?)?;
            let name: String = required("name")?.extract()?;
            let material = material.and_then(|number| materials.get(number));
            let material = material.map(|material| material.get().described());
            self.insert(py, Part { transforms, ..Part::new(name, mesh) }, material)?;
        }
        Ok(())
    }

    fn __repr__(&self) -> PyResult<String> {
        let assembly = self.state.now()?.assembly;
        let (objects, triangles) = (assembly.parts().len(), assembly.triangle_count());
        Ok(format!("Scene({objects} object{}, {triangles} triangles)", if objects == 1 { "" } else { "s" }))
    }
}

impl Scene {
    /// Adds a part with its material.
    fn insert(&self, py: Python<'_>, part: Part, material: Option<Arc<Described>>) -> PyResult<()> {
        let threads = Threads::all()?;
        let added = self.state.change(|state| threads.run(py, || state.add(part, material)))?;
        added.map_err(|error| refused(&error))
    }

    /// The scene, which is put together at the first call after a change. It shares its mesh.
    ///
    /// # Errors
    /// ValueError for what is wrong with the whole, MemoryError if it does not fit, RuntimeError while another thread
    /// changes it.
    pub fn scene(&self, py: Python<'_>) -> PyResult<scene::Scene> {
        let State { assembly, built, changes, .. } = self.state.now()?;
        if let Some(scene) = built {
            return Ok(scene);
        }
        // Not under the lock, which no fork must find held.
        let built = Threads::all()?.run(py, || assembly.build(MemoryBudget::of_machine()));
        let scene = built.map_err(|error| refused(&error))?;
        self.state.try_change(|state| {
            if state.changes == changes {
                state.built = Some(scene.clone());
            }
        });
        Ok(scene)
    }

    /// A scene of a mesh that answers questions, with its normals.
    ///
    /// # Errors
    /// If the mesh has no triangles.
    pub fn of_mesh(mesh: &Bound<'_, Mesh>) -> PyResult<Self> {
        let py = mesh.py();
        Self::new(py, Some(mesh.as_any()), None, "mesh", None, None, None, None, None, None)
    }
}

/// The mesh of arguments.
fn mesh_of(
    vertices: &Bound<'_, PyAny>,
    faces: Given<'_, '_>,
    of: &Attributes<'_, '_>,
) -> PyResult<TriangleMesh> {
    let mut mesh = match vertices.cast::<Mesh>() {
        Ok(_) if faces.is_some() => return Err(PyValueError::new_err("a Mesh has its own faces")),
        Ok(mesh) => {
            let target = Mesh::of(mesh)?;
            let mut mesh = TriangleMesh::new(target.vertices.rounded(), target.faces.to_vec());
            if let Some(normals) = target.normals {
                mesh.normals = normals.iter().copied().map(Vec3::from).collect();
            }
            mesh
        }
        Err(_) => {
            let Geometry { vertices, faces } = Geometry::new(vertices, faces)?;
            TriangleMesh::new(vertices.rounded(), faces)
        }
    };
    let count = mesh.positions.len();
    if let Some(normals) = of.normals {
        let normals = checked(&numbers(normals, "normals")?, &[count, 3], "normals")?;
        mesh.normals = normals.as_chunks::<3>().0.iter().copied().map(Vec3::from).collect();
    }
    if let Some(colours) = of.colours {
        let colours = numbers::<f32>(colours, "colours")?;
        let channels = if colours.shape().last() == Some(&4) { 4 } else { 3 };
        let colours = checked(&colours, &[count, channels], "colours")?;
        let colour = |row: &[f32]| Vec4::new(row[0], row[1], row[2], row.get(3).copied().unwrap_or(1.0));
        mesh.colours = colours.chunks_exact(channels).map(colour).collect();
    }
    if let Some(uvs) = of.uvs {
        let uvs = numbers::<f32>(uvs, "uvs")?;
        let sets = match leading(&uvs, 2, "uvs")?.as_slice() {
            [vertices] if *vertices == count => 1,
            [sets, vertices] if *sets > 0 && *vertices == count => *sets,
            found => {
                let told = format!("uvs {found:?} for {count} vertices; they must be (v, 2) or (n, v, 2)");
                return Err(PyValueError::new_err(told));
            }
        };
        let rows: Vec<Vec2> = uvs.as_slice()?.as_chunks::<2>().0.iter().copied().map(Vec2::from).collect();
        let mut sets = (0..sets).map(|set| rows[set * count..][..count].to_vec());
        mesh.uvs = sets.next().unwrap_or_default();
        mesh.more_uvs = sets.collect();
    }
    if let Some(named) = of.named {
        let named =
            named.cast::<PyDict>().map_err(|_| PyTypeError::new_err("attributes: a dictionary of arrays"))?;
        mesh.attributes = named
            .iter()
            .map(|(name, values)| named_attribute(&name, &values, count))
            .collect::<PyResult<_>>()?;
    }
    Ok(mesh)
}

/// An attribute with a name of its own, of so many vertices.
fn named_attribute(
    name: &Bound<'_, PyAny>,
    values: &Bound<'_, PyAny>,
    count: usize,
) -> PyResult<VertexAttribute> {
    let name: String = name.extract()?;
    let told = format!("attributes[{name:?}]");
    let values = numbers::<f32>(values, &told)?;
    let width = match *values.shape() {
        [_] => 1,
        [_, width @ 1..=4] => width,
        _ => {
            let found = format!(
                "{told} {:?} for {count} vertices; it must be (v,) or (v, n), n from 1 to 4",
                values.shape()
            );
            return Err(PyValueError::new_err(found));
        }
    };
    let expected = if values.shape().len() == 1 { vec![count] } else { vec![count, width] };
    let values = checked(&values, &expected, &told)?;
    Ok(VertexAttribute { name, width: width as u32, values })
}

/// The keywords of `add` that make a part, but for its material.
fn keywords_of<'py>(py: Python<'py>, part: &Part) -> PyResult<Bound<'py, PyDict>> {
    let (keywords, mesh): (_, &Shared<TriangleMesh>) = (PyDict::new(py), &part.mesh);
    let rows = |vectors: &[Vec3]| {
        array(py, bytemuck::cast_slice::<Vec3, f32>(vectors).to_vec(), &[vectors.len()], 3)
    };
    keywords.set_item("name", &part.name)?;
    keywords.set_item("vertices", rows(&mesh.positions)?)?;
    keywords
        .set_item("faces", array(py, mesh.triangles.as_flattened().to_vec(), &[mesh.triangles.len()], 3)?)?;
    let matrix = |matrix: &DMat4| matrix.transpose().to_cols_array();
    let transforms: Vec<f64> = part.transforms.iter().flat_map(matrix).collect();
    keywords
        .set_item("transform", PyArray::from_vec(py, transforms).reshape([part.transforms.len(), 4, 4])?)?;
    if !mesh.normals.is_empty() {
        keywords.set_item("normals", rows(&mesh.normals)?)?;
    }
    if !mesh.colours.is_empty() {
        let colours = bytemuck::cast_slice::<Vec4, f32>(&mesh.colours).to_vec();
        keywords.set_item("colours", array(py, colours, &[mesh.colours.len()], 4)?)?;
    }
    if !mesh.uvs.is_empty() {
        let sets = [&mesh.uvs].into_iter().chain(&mesh.more_uvs);
        let uvs: Vec<f32> = sets.flat_map(|uvs| bytemuck::cast_slice::<Vec2, f32>(uvs)).copied().collect();
        let shape = [1 + mesh.more_uvs.len(), mesh.uvs.len()];
        keywords.set_item("uvs", array(py, uvs, &shape, 2)?)?;
    }
    if !mesh.attributes.is_empty() {
        let named = PyDict::new(py);
        for VertexAttribute { name, width, values } in &mesh.attributes {
            let rows = [mesh.positions.len()];
            named.set_item(name, array(py, values.clone(), &rows, *width as usize)?)?;
        }
        keywords.set_item("attributes", named)?;
    }
    Ok(keywords)
}
