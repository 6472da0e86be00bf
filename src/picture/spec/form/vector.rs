//! Several numbers: sizes, vectors, intrinsics, distortions.

use super::{Form, joined, number, numbers_schema};
use crate::scene::{Distortion, Intrinsics};
use glam::{Vec2, Vec3};
use serde_json::{Value, json};

/// `WxH`, both at least 1 and at most 2²⁸ pixels together; as JSON also two numbers.
#[derive(Debug)]
pub struct Size;

impl Form for Size {
    type Value = (u32, u32);

    fn read(text: &str) -> Result<(u32, u32), String> {
        let (w, h) = text.split_once(['x', 'X', ',']).ok_or("write WIDTHxHEIGHT, as in 960x540")?;
        let number = |s: &str| s.trim().parse::<u32>().map_err(|e| format!("{s:?}: {e}"));
        let (w, h) = (number(w)?, number(h)?);
        if w == 0 || h == 0 || u64::from(w) * u64::from(h) > 1 << 28 {
            return Err(
                "width and height must be at least 1, and the picture at most 268435456 pixels".into()
            );
        }
        Ok((w, h))
    }

    fn text(&(w, h): &(u32, u32)) -> String {
        format!("{w}x{h}")
    }

    fn schema() -> Value {
        json!({ "anyOf": [
            { "type": "string", "pattern": "^[0-9]+[xX][0-9]+$" },
            { "type": "array", "items": { "type": "integer", "minimum": 1 }, "minItems": 2, "maxItems": 2 }
        ] })
    }
}

/// `X,Y,Z`, all finite.
#[derive(Debug)]
pub struct Vector;

impl Form for Vector {
    type Value = Vec3;

    fn read(text: &str) -> Result<Vec3, String> {
        let parts: Vec<f32> = text
            .split(',')
            .map(|s| s.trim().parse::<f32>().map_err(|e| format!("{s:?}: {e}")))
            .collect::<Result<_, _>>()?;
        match parts[..] {
            [x, y, z] if parts.iter().all(|p| p.is_finite()) => Ok(Vec3::new(x, y, z)),
            _ => Err("write three finite numbers, as in 1,-2.5,3".into()),
        }
    }

    fn text(value: &Vec3) -> String {
        joined(value.to_array())
    }

    fn json(value: &Vec3) -> Value {
        value.to_array().into_iter().map(number).collect()
    }

    fn schema() -> Value {
        numbers_schema(3, 3)
    }
}

/// Finite numbers with commas between them.
fn numbers(text: &str) -> Result<Vec<f64>, String> {
    let number = |s: &str| s.trim().parse::<f64>().map_err(|e| format!("{s:?}: {e}"));
    let numbers: Vec<f64> = text.split(',').map(number).collect::<Result<_, _>>()?;
    if numbers.iter().all(|n| n.is_finite()) { Ok(numbers) } else { Err("numbers must be finite".into()) }
}

/// `X,Y`.
#[derive(Debug)]
pub struct Shift;

impl Form for Shift {
    type Value = Vec2;

    fn read(text: &str) -> Result<Vec2, String> {
        match numbers(text)?[..] {
            [x, y] => Ok(Vec2::new(x as f32, y as f32)),
            _ => Err("write two numbers X,Y, as in 0,0.25".into()),
        }
    }

    fn text(value: &Vec2) -> String {
        joined(value.to_array())
    }

    fn json(value: &Vec2) -> Value {
        value.to_array().into_iter().map(number).collect()
    }

    fn schema() -> Value {
        numbers_schema(2, 2)
    }
}

/// `FX,FY,CX,CY`.
#[derive(Debug)]
pub struct Calibration;

impl Form for Calibration {
    type Value = Intrinsics;

    fn read(text: &str) -> Result<Intrinsics, String> {
        match numbers(text)?[..] {
            [fx, fy, cx, cy] => Ok(Intrinsics::new(fx, fy, cx, cy)),
            _ => Err("write four numbers FX,FY,CX,CY in pixels, as in 610,608.5,322.4,241".into()),
        }
    }

    fn text(k: &Intrinsics) -> String {
        joined([k.fx, k.fy, k.cx, k.cy])
    }

    fn json(k: &Intrinsics) -> Value {
        [k.fx, k.fy, k.cx, k.cy].into_iter().map(number).collect()
    }

    fn schema() -> Value {
        numbers_schema(4, 4)
    }
}

/// `K1,K2,P1,P2[,K3[,K4,K5,K6[,S1,S2,S3,S4]]]`.
#[derive(Debug)]
pub struct BrownConrady;

impl Form for BrownConrady {
    type Value = Distortion;

    fn read(text: &str) -> Result<Distortion, String> {
        let numbers = numbers(text)?;
        Distortion::brown_conrady(&numbers)
            .ok_or_else(|| format!("{} numbers; write 4, 5, 8 or 12, in OpenCV's order", numbers.len()))
    }

    fn text(value: &Distortion) -> String {
        joined(coefficients(value))
    }

    fn json(value: &Distortion) -> Value {
        coefficients(value).into_iter().map(number).collect()
    }

    fn schema() -> Value {
        numbers_schema(4, 12)
    }
}

/// The coefficients of a distortion in OpenCV's order.
fn coefficients(distortion: &Distortion) -> Vec<f64> {
    match *distortion {
        Distortion::BrownConrady { k: [k1, k2, k3, k4, k5, k6], p: [p1, p2], s: [s1, s2, s3, s4] } => {
            vec![k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4]
        }
        Distortion::Fisheye { k } => k.to_vec(),
        _ => Vec::new(),
    }
}

/// `K1,K2,K3,K4`.
#[derive(Debug)]
pub struct Fisheye;

impl Form for Fisheye {
    type Value = Distortion;

    fn read(text: &str) -> Result<Distortion, String> {
        let k = numbers(text)?.try_into().map_err(|_| "write four numbers K1,K2,K3,K4")?;
        Ok(Distortion::Fisheye { k })
    }

    fn text(value: &Distortion) -> String {
        joined(coefficients(value))
    }

    fn json(value: &Distortion) -> Value {
        coefficients(value).into_iter().map(number).collect()
    }

    fn schema() -> Value {
        numbers_schema(4, 4)
    }
}
