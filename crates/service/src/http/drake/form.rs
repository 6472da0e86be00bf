//! The form that a client of Drake's sends.

use crate::contract::Problem;
use crate::contract::refused;
use crate::coordinator::store::{Passing, Upload};
use crate::http::api::{Pieces, media_type};
use crate::http::state::State;
use axum::body::Body;
use axum::http::{HeaderMap, StatusCode, header};
use futures_util::stream;
use multer::{Constraints, Field, Multipart, SizeLimit};
use std::collections::BTreeMap;
use std::str::FromStr;

/// The most bytes of a field that is text.
const TEXT_BYTES: u64 = 4096;

/// The kind of picture that is wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ImageType {
    /// Light.
    Colour,
    /// Distance along the view axis, in metres.
    Depth {
        /// What is nearer is too close.
        least: f32,
        /// What is farther is too far.
        most: f32,
    },
    /// The colour by which Drake knows a geometry.
    Label,
}

/// The fields.
#[derive(Clone, Debug, PartialEq)]
pub struct Form {
    pub image: ImageType,
    /// Width and height in pixels.
    pub size: (u32, u32),
    /// Focal lengths along x and y, in pixels.
    pub focal: [f64; 2],
    /// Principal point in pixels; the centre of the top left pixel is (0, 0).
    pub centre: [f64; 2],
    /// The hash of the scene as the client says.
    sha256: String,
}

/// Reads a form, and writes its scene to the disk.
///
/// # Errors
/// 415 if the body is no form; 400 if it is damaged; 413 and 408 as for [`Pieces::next`]; 422 if a field is missing or
/// makes no sense.
pub async fn read(state: &State, headers: &HeaderMap, body: Body) -> Result<(Form, Upload), Problem> {
    let kind = headers.get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    if media_type(headers) != "multipart/form-data" {
        let detail = "send a form, with `Content-Type: multipart/form-data`";
        return Err(Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, detail));
    }
    let boundary = multer::parse_boundary(kind).map_err(problem)?;
    let most = state.limits().scene_bytes;
    let pieces = Pieces::new(state, body, ("scene_bytes", most));
    let pieces = stream::unfold(pieces, |mut pieces| async {
        let piece = pieces.next().await.transpose()?;
        Some((piece, pieces))
    });
    let size = SizeLimit::new().per_field(TEXT_BYTES).for_field("scene", most);
    let pieces = Box::pin(pieces);
    let mut form = Multipart::with_constraints(pieces, boundary, Constraints::new().size_limit(size));
    let (mut texts, mut scene) = (BTreeMap::new(), None);
    while let Some(field) = form.next_field().await.map_err(problem)? {
        match field.name().map(str::to_owned) {
            Some(name) if name == "scene" => scene = Some(keep(state, field).await?),
            Some(name) => drop(texts.insert(name, field.text().await.map_err(problem)?)),
            None => {}
        }
    }
    let scene = scene.ok_or_else(|| missing("scene"))?;
    Ok((Form::of(&texts)?, scene))
}

/// Writes the scene's bytes as they come.
async fn keep(state: &State, mut field: Field<'_>) -> Result<Upload, Problem> {
    let mut upload = state.blocking(|state| state.store().begin().map_err(refused)).await?;
    while let Some(piece) = field.chunk().await.map_err(problem)? {
        let written = state.blocking(move |_| {
            upload.write(&piece).map_err(refused)?;
            Ok(upload)
        });
        upload = written.await?;
    }
    Ok(upload)
}

/// A refusal because of a damaged form, or the one that reading its bytes has met.
fn problem(error: multer::Error) -> Problem {
    match error {
        multer::Error::StreamReadFailed(error) => match error.downcast::<Problem>() {
            Ok(problem) => *problem,
            Err(error) => Problem::malformed(format!("the form cannot be read: {error}")),
        },
        multer::Error::FieldSizeExceeded { limit, field_name } => {
            let name = field_name.unwrap_or_default();
            let detail = format!("the field {name:?} has more than {limit} bytes; make it smaller");
            Problem::limit(StatusCode::PAYLOAD_TOO_LARGE, "form_field_bytes", limit, detail)
        }
        error => Problem::malformed(format!("the form is damaged: {error}")),
    }
}

fn missing(name: &str) -> Problem {
    Problem::unprocessable(format!(
        "{name}: the form lacks this field; see Drake's glTF Render Client-Server API"
    ))
}

fn wrong(name: &str, text: &str, wanted: &str) -> Problem {
    Problem::unprocessable(format!("{name}: {text:?} is not {wanted}"))
}

/// The text of a field.
fn text<'a>(texts: &'a BTreeMap<String, String>, name: &str) -> Result<&'a str, Problem> {
    texts.get(name).map(|text| text.trim()).ok_or_else(|| missing(name))
}

/// A number of a field that passes a test.
fn number<T: FromStr>(
    texts: &BTreeMap<String, String>,
    name: &str,
    wanted: &str,
    is_good: impl Fn(&T) -> bool,
) -> Result<T, Problem> {
    let text = text(texts, name)?;
    text.parse().ok().filter(is_good).ok_or_else(|| wrong(name, text, wanted))
}

impl Form {
    fn of(texts: &BTreeMap<String, String>) -> Result<Self, Problem> {
        let pixels = |name: &str| number(texts, name, "a number of pixels", |&count: &u32| count > 0);
        let length =
            |name: &str| number(texts, name, "a positive number", |x: &f64| x.is_finite() && *x > 0.0);
        let place = |name: &str| number(texts, name, "a number of pixels", |x: &f64| x.is_finite());
        let (width, height) = (pixels("width")?, pixels("height")?);
        let (near, far) = (length("near")?, length("far")?);
        if near >= far {
            return Err(wrong("near", text(texts, "near")?, "less than far"));
        }
        let image = match text(texts, "image_type")? {
            "color" => ImageType::Colour,
            "label" => ImageType::Label,
            "depth" => {
                let distance =
                    |name: &str| number(texts, name, "a distance", |x: &f64| x.is_finite() && *x >= 0.0);
                let (least, most) = (distance("min_depth")?, distance("max_depth")?);
                if least >= most {
                    return Err(wrong("min_depth", text(texts, "min_depth")?, "less than max_depth"));
                }
                ImageType::Depth { least: least as f32, most: most.min(far) as f32 }
            }
            other => return Err(wrong("image_type", other, "color, depth or label")),
        };
        Ok(Self {
            image,
            size: (width, height),
            focal: [length("focal_x")?, length("focal_y")?],
            centre: [place("center_x")?, place("center_y")?],
            sha256: text(texts, "scene_sha256")?.to_ascii_lowercase(),
        })
    }

    /// Refuses a scene that has changed on its way. What is no SHA-256 is not compared.
    pub fn check_hash(&self, scene: &Passing) -> Result<(), Problem> {
        let is_hash = self.sha256.len() == 64 && self.sha256.bytes().all(|byte| byte.is_ascii_hexdigit());
        if is_hash && self.sha256 != scene.sha256() {
            let detail =
                format!("the scene's SHA-256 is {}, not scene_sha256; send it again", scene.sha256());
            return Err(Problem::unprocessable(detail));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts() -> BTreeMap<String, String> {
        let fields = [
            ("scene_sha256", "x"),
            ("image_type", "depth"),
            ("width", "640"),
            ("height", "480"),
            ("near", "0.01"),
            ("far", "10.000000"),
            ("focal_x", "579.4"),
            ("focal_y", "579.5"),
            ("fov_x", "0.785398"),
            ("fov_y", "0.785398"),
            ("center_x", "319.5"),
            ("center_y", "239.5"),
            ("min_depth", "0.1"),
            ("max_depth", "20"),
            ("submit", "Render"),
        ];
        fields.map(|(name, text)| (name.to_owned(), text.to_owned())).into()
    }

    #[test]
    fn forms_are_read_and_what_is_wrong_is_named() {
        let form = Form::of(&texts()).expect("a form");
        assert_eq!(form.image, ImageType::Depth { least: 0.1, most: 10.0 }, "no farther than the view");
        assert_eq!((form.size, form.focal, form.centre), ((640, 480), [579.4, 579.5], [319.5, 239.5]));
        for (name, bad) in [
            ("width", "0"),
            ("height", "1.5"),
            ("focal_x", "-1"),
            ("focal_y", "inf"),
            ("center_x", "nan"),
            ("near", "11"),
            ("min_depth", "30"),
            ("image_type", "heat"),
        ] {
            let mut texts = texts();
            texts.insert(name.into(), bad.into());
            let problem = Form::of(&texts).expect_err(name);
            assert!(problem.detail().starts_with(name) && problem.detail().contains(bad), "{problem}");
            texts.remove(name);
            assert!(Form::of(&texts).expect_err(name).detail().contains("lacks"), "{name}");
        }
    }
}
