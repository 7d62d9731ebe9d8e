//! The scalar program on a GPU against the CPU, along a deformation path.

use std::rc::Rc;

use gradreel::ops::Map;
use gradreel::scalar::{Program, Scalar};
use gradreel::{Device, Error, ErrorKind, Result, Tape, Tensor};

use super::MaterialCheck;
use super::response::Subject;
use crate::physics::law::Law;

/// Number of points on the path.
const POINTS: usize = 400;
/// Allowed share of points on different sides of a kink.
const OUTLIERS: f64 = 0.02;

/// Compares projection and stress, contracted to one number, and its derivative along the path, both in `f32`.
///
/// # Errors
/// Propagates errors of the tape.
pub(super) fn check(law: &Law) -> Result<MaterialCheck> {
    const NAME: &str = "CPU and WGSL";
    let gpu = match Device::gpu() {
        Ok(gpu) => gpu,
        Err(error) if error.kind() == ErrorKind::Device => return Ok(MaterialCheck::skipped(NAME, "no GPU here")),
        Err(error) => return Err(error),
    };
    let map = Rc::new(Map::new(along(law)));
    // The path avoids rest, where CPU and GPU may round to different sides of a kink.
    let points: Vec<f32> = (0..POINTS).map(|i| (i as f32 + 0.37) * 2.0 / POINTS as f32 - 1.0).collect();
    let on = |device: &Device| -> Result<[Vec<f64>; 2]> {
        let tape = Tape::new();
        let x = tape.leaf(Tensor::from_vec(points.clone(), [POINTS]).to_device(device)?);
        let y = tape.apply(map.clone(), &[&x])?;
        let slope = y.sum_all().backward()?.wrt(&x)?.to_vec()?;
        Ok([y.value()?.to_vec()?, slope])
    };
    let (cpu, gpu) = (on(&Device::Cpu)?, on(&gpu)?);
    let mut found = 0.0_f64;
    for (cpu, gpu) in cpu.iter().zip(&gpu) {
        let scale = cpu.iter().fold(0.0_f64, |most, y| most.max(y.abs()));
        let mut off: Vec<f64> = cpu.iter().zip(gpu).map(|(a, b)| (a - b).abs() / scale).collect();
        if off.iter().any(|x| x.is_nan()) {
            return Err(Error::new(ErrorKind::NonFinite, "the material is not finite on its path").at(law.name()));
        }
        off.sort_by(f64::total_cmp);
        found = found.max(off[((1.0 - OUTLIERS) * POINTS as f64) as usize - 1]);
    }
    Ok(MaterialCheck { name: NAME, found, allowed: 1e-3, note: "values and derivative, f32".to_owned() })
}

/// The material along `F = I + t A + t² B`, `C = t A`: one input, one output of order 1.
fn along(law: &Law) -> Program {
    let subject = Subject::new(law);
    let known = subject.inputs([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], [0.0; 9]);
    Program::trace(&format!("{}_path", law.name()), &["t"], &["y"], |x| {
        let t = x[0];
        let inputs: Vec<Scalar> = known
            .iter()
            .enumerate()
            .map(|(k, &value)| match k {
                0..9 => value + t * (0.15 * (1.3 * k as f64 + 0.4).sin()) + t * t * (0.05 * (2.1 * k as f64).cos()),
                9..18 => t * (1.3 * (k - 9) as f64 + 0.4).sin(),
                _ => value.into(),
            })
            .collect();
        let outputs = law.program().apply(&inputs);
        let weighted = outputs.into_iter().enumerate().map(|(k, y)| {
            let scale = if (9..18).contains(&k) { 1.0 / subject.modulus } else { 1.0 };
            y * (scale * (0.6 + 0.1 * k as f64))
        });
        vec![weighted.sum()]
    })
}
