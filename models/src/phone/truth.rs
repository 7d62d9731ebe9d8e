//! What is true of a film.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use super::Degradation;
use super::motion::Motion;
use super::picture::Studio;
use super::plan::Plan;
use crate::scenes::SceneFile;

/// Share of gravity by which the acceleration of what touches something differs from it.
const TOUCHED: f64 = 0.5;
/// Contacts nearer than this are one \[s\].
const APART: f64 = 0.012;

/// The truth, as it is written beside a film.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Truth {
    /// What falls.
    pub title: String,
    /// What the film has that films of a studio have not.
    pub degradations: Vec<Degradation>,
    /// Pictures a second, as they were taken.
    pub fps: f64,
    /// Pictures a second, as the file says.
    pub stored_fps: f64,
    /// Number of pictures.
    pub frames: usize,
    /// Time of each since the object was let go \[s\].
    pub times_s: Vec<f64>,
    /// Number of the first picture in which the object is free.
    pub first_free: usize,
    /// The object's contacts with the ground in the order of time.
    pub hits: Vec<Contact>,
    /// Diameter of the disc that the object covers when it is let go \[m\].
    pub diameter_m: f64,
    /// Distance of its centre from the camera then, along the axis of the camera \[m\].
    pub distance_m: f64,
    /// Angle by which the camera looks down \[°\].
    pub pitch_deg: f64,
    /// Velocity of its centre when it is let go \[m/s\].
    pub velocity_m_per_s: [f64; 3],
    /// Name of its law, and the values of the parameters in SI units.
    pub law: String,
    pub parameters: BTreeMap<String, f64>,
    /// Coefficient of friction between object and ground.
    pub ground_friction: Option<f64>,
    /// Exposure and time between the first row and the last \[s\].
    pub exposure_s: f64,
    pub readout_s: f64,
}

/// A contact.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Contact {
    /// Number of the first picture at or after its beginning.
    pub frame: usize,
    /// Its beginning and its end since the object was let go \[s\]; without an end it stays there.
    pub begin_s: f64,
    pub end_s: Option<f64>,
    /// Vertical speed after it as a share of that before.
    pub restitution: Option<f64>,
}

impl Truth {
    /// The truth of a film of a simulated scene.
    pub(super) fn of(
        file: &SceneFile,
        motion: &Motion,
        plan: &Plan,
        studio: &Studio<'_>,
        degradations: &[Degradation],
    ) -> Result<Self> {
        let camera = &motion.camera;
        let start = plan.times.iter().find(|time| **time >= 0.0).copied().unwrap_or(0.0);
        let Some([.., depth]) = camera.project(motion.centre(start)) else {
            return Err(Error::new(ErrorKind::Input, "the object is not before the camera")
                .at("film.target_m")
                .fix("correct the camera in the scene file"));
        };
        let covered = studio.covered(start)? * (depth / camera.fx) * (depth / camera.fy);
        let object = &file.objects[0];
        let stuff = &file.materials[&object.material];
        let (heights, dt) = motion.heights();
        Ok(Self {
            title: file.title.clone(),
            degradations: degradations.to_vec(),
            fps: plan.rate,
            stored_fps: plan.rate / plan.slower,
            frames: plan.times.len(),
            times_s: plan.times.clone(),
            first_free: plan.times.partition_point(|time| *time < 0.0),
            hits: contacts(&heights, dt, motion.gravity, &plan.times),
            diameter_m: 2.0 * (covered / std::f64::consts::PI).sqrt(),
            distance_m: depth,
            pitch_deg: camera.c2w[1][2].asin().to_degrees(),
            velocity_m_per_s: object.velocity_m_s,
            law: stuff.law.clone(),
            parameters: stuff.parameters.clone(),
            ground_friction: file.ground.as_ref().and_then(|ground| ground.friction),
            exposure_s: plan.exposure,
            readout_s: plan.readout,
        })
    }

    /// Writes it as JSON.
    pub(super) fn write(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self)
            .map_err(|e| Error::new(ErrorKind::Io, "cannot write the truth of a film as JSON").found(e))?;
        fs::write(path, text).map_err(|e| Error::io(path, "write the truth of a film", &e))
    }
}

/// Contacts of a centre whose heights are `dt` apart: there it does not fall freely. Times of pictures give their numbers.
fn contacts(heights: &[f64], dt: f64, gravity: f64, times: &[f64]) -> Vec<Contact> {
    let is_touched = |k: usize| {
        let acceleration = (heights[k + 1] - 2.0 * heights[k] + heights[k - 1]) / (dt * dt);
        (acceleration + gravity).abs() > TOUCHED * gravity
    };
    let mut spans: Vec<[usize; 2]> = Vec::new();
    for k in (1..heights.len().saturating_sub(1)).filter(|k| is_touched(*k)) {
        match spans.last_mut() {
            Some(span) if (k - span[1]) as f64 * dt <= APART => span[1] = k,
            _ => spans.push([k, k]),
        }
    }
    let speed = |k: usize| (heights[k + 1] - heights[k]) / dt;
    let contact = |[first, last]: [usize; 2]| {
        let begin_s = first as f64 * dt;
        let leaves = last + 2 < heights.len();
        let restitution = leaves.then(|| speed(last + 1) / -speed(first - 1)).filter(|_| first > 1);
        Contact {
            frame: times.partition_point(|time| *time < begin_s),
            begin_s,
            end_s: leaves.then_some(last as f64 * dt),
            restitution,
        }
    };
    spans.into_iter().map(contact).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contacts_of_a_ball_that_bounces() {
        // 0.6 of the speed is left after a contact of 10 ms
        let (dt, g) = (1.0 / 480.0, 9.8);
        let (mut y, mut v) = (0.45, 0.0);
        let mut heights = vec![];
        let mut left: Option<f64> = None;
        for _ in 0..500 {
            heights.push(y);
            match left {
                Some(rest) if rest > 0.0 => {
                    v += 1.6 * (2.0 * g * 0.45_f64).sqrt() * dt / 0.01;
                    left = Some(rest - dt);
                }
                None if y < 0.0 => left = Some(0.01 - dt),
                _ => v -= g * dt,
            }
            y += v * dt;
        }
        let times: Vec<f64> = (0..30).map(|k| f64::from(k) / 30.0).collect();
        let found = contacts(&heights, dt, g, &times);
        assert_eq!(found.len(), 1, "{found:?}");
        let fall = (2.0 * 0.45_f64 / g).sqrt();
        assert!((found[0].begin_s - fall).abs() < 0.006 && found[0].frame == 10, "{found:?}");
        assert!(found[0].end_s.is_some_and(|end| (end - fall - 0.01).abs() < 0.006), "{found:?}");
    }
}
