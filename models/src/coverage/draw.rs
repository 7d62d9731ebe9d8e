//! What a clip is made of, drawn from a split and a number.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use gradreel::{Error, ErrorKind, Key, Result};
use serde::{Deserialize, Serialize};

use super::material;
use crate::identify::{Config, FAMILIES, MaterialConfig};
use crate::physics::{Law, Schedule};
use crate::video::Camera;
use crate::views::objects::{Body, Dice, Made};

/// Which clips: those that a method may be developed on, or those that are only reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// For development
    Development,
    /// For reports only
    Report,
}

impl Split {
    /// The key of a clip; those of the two splits never meet.
    fn key(self, number: u64) -> Key {
        Key::new(match self {
            Self::Development => 0x0dd5,
            Self::Report => 0xe4e5,
        })
        .fold(number)
    }

    /// The key of a scene that a phone films; it meets no clip's.
    pub(crate) fn scene(self, number: u64) -> Key {
        self.key(1 << 40 | number)
    }
}

/// A clip before it is made. Everything follows from the split, the number and the count of cameras.
pub struct Recipe {
    /// Its material: a family, or a law of one's own.
    pub material: MaterialConfig,
    /// The law of that.
    pub law: Law,
    /// The parameters of its law by name, in SI units.
    pub parameters: BTreeMap<String, f64>,
    /// Initial velocity \[m/s\].
    pub velocity: [f64; 3],
    /// How likely the truth was: the logarithm of the density from which each unknown was drawn, on the scale of its fit.
    pub log_prior: BTreeMap<String, f64>,
    /// The shape, its longest side 1.
    pub(super) body: Made,
    /// The longest side \[m\].
    pub(super) size: f64,
    /// Where the middle of the body's box is at first \[m\].
    pub(super) start: [f64; 3],
    /// Grid spacings of the fit and of the simulation \[m\].
    pub(super) spacings: [f64; 2],
    /// Substeps of the simulation in units of the longest stable one.
    pub(super) step: f64,
    /// Frames and the time between them \[s\]; the substeps follow from the material.
    pub(super) schedule: Schedule,
    /// The cameras.
    pub cameras: Vec<Camera>,
    /// Whether the fit is told where the camera is.
    pub calibrated: bool,
    /// Whether the pictures have a background with a floor and a shadow; they are cut out otherwise.
    pub background: bool,
    /// For the background's pattern and the noise of its pictures.
    pub(super) paint: Key,
}

/// Nodes of a body's distance field along its longest side.
const NODES: usize = 64;
/// Longest sides of bodies \[m\].
const SIZES: [f64; 2] = [0.15, 0.45];
/// Particles of a fit.
const PARTICLES: [f64; 2] = [1000.0, 3000.0];
/// Grid spacings of simulations, in units of the fit's.
const SPACINGS: [f64; 2] = [0.6, 1.4];
/// Spacings that a search can choose, in the same units, and how far the simulation's stays away from them.
const CHOSEN: [f64; 2] = [0.7, 1.0];
const AWAY: f64 = 0.04;
/// How far bodies fall \[m\], and standard deviations of their velocities along x, y and z \[m/s\].
const FALLS: [f64; 2] = [0.15, 0.5];
const VELOCITIES: [f64; 3] = [0.5, 0.5, 0.5];
/// Frames, and what part of the time before contact comes after it.
const FRAMES: [usize; 2] = [12, 16];
const AFTER: [f64; 2] = [0.7, 1.3];
/// Sides of pictures \[pixels\], and their angle of view \[°\].
const SIDES: [usize; 2] = [64, 96];
const VIEW: f64 = 40.0;

impl Recipe {
    /// Draws a clip that so many cameras film, of a material of one of the families in turn, or of a law of one's own.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a number of cameras that is not 1 to 16, or a law whose priors hold nothing.
    pub fn draw(split: Split, number: u64, cameras: usize, own: Option<&Law>) -> Result<Self> {
        if !(1..=16).contains(&cameras) {
            return Err(Error::new(ErrorKind::Input, "a clip cannot have so many cameras")
                .at("--cameras")
                .found(cameras)
                .wanted("1 to 16")
                .fix("give 1 or 7, as the tables have"));
        }
        let [shape, colours, stuff, way, seen, paint] = split.key(number).split();
        // all families come equally often
        let family = FAMILIES[(number % FAMILIES.len() as u64) as usize].0;
        let config = match own {
            Some(law) => Config::default().with_law(law.clone()),
            None => Config { material: material::named(family), ..Config::default() },
        };
        let (parameters, mut log_prior) = material::draw(&config, stuff)?;

        let mut dice = Dice::new(way);
        let thin = dice.chance(0.2);
        let parts = 1 + dice.below(9);
        let body = Made::of(|key| Body::of_parts(key, parts, thin), [shape, colours], NODES);
        let size = between(&mut dice, SIZES);
        let volume = size.powi(3) * volume(&body);
        let spacing = rounded(2.0 * (volume / between(&mut dice, PARTICLES)).cbrt());
        let other = std::iter::repeat_with(|| dice.within(SPACINGS[0], SPACINGS[1]))
            .find(|share| CHOSEN.iter().all(|chosen| (share - chosen).abs() > AWAY))
            .expect("most are far enough");
        let step = dice.within(0.4, 0.9);

        let fall = dice.within(FALLS[0], FALLS[1]);
        let mut velocity = [0.0; 3];
        for ((axis, speed), deviation) in velocity.iter_mut().enumerate().zip(VELOCITIES) {
            let normal = way.fold(7 + axis as u64).normal(1).next().expect("one number");
            *speed = deviation * normal;
            let density = -0.5 * normal * normal - (deviation * TAU.sqrt()).ln();
            log_prior.insert(format!("velocity_{}", ["x", "y", "z"][axis]), density);
        }
        let g = -config.world.gravity[1];
        let contact = (velocity[1] + (velocity[1].powi(2) + 2.0 * g * fall).sqrt()) / g;
        let frames = FRAMES[0] + dice.below(FRAMES[1] - FRAMES[0] + 1);
        let duration = contact * (1.0 + dice.within(AFTER[0], AFTER[1]));
        let frame_dt = duration / (frames - 1) as f64;
        let half = body.half()[1] * size;
        let start = [dice.within(-0.05, 0.05), fall + half, dice.within(-0.05, 0.05)];

        let mut scene = Self {
            law: config.law()?,
            material: config.material,
            parameters,
            velocity,
            log_prior,
            size,
            start,
            spacings: [spacing, other * spacing],
            step,
            schedule: Schedule { frames, frame_dt, substeps: 1 },
            cameras: Vec::new(),
            calibrated: true,
            background: dice.chance(0.5),
            paint,
            body,
        };
        let mut placing = Dice::new(seen.fold(cameras as u64));
        scene.calibrated = cameras > 1 || placing.chance(0.5);
        scene.film_with(cameras, contact, duration, &mut placing);
        Ok(scene)
    }

    /// Places cameras around the body's way.
    fn film_with(&mut self, cameras: usize, contact: f64, duration: f64, dice: &mut Dice) {
        // the way along the floor slows down after contact
        let far = [0, 2].map(|axis| self.velocity[axis] * (contact + 0.3 * (duration - contact)));
        let ends = [self.start, [self.start[0] + far[0], 0.0, self.start[2] + far[1]]];
        let rise = 0.5 * self.velocity[1].max(0.0).powi(2) / 9.8;
        let middle: [f64; 3] = std::array::from_fn(|axis| 0.5 * (ends[0][axis] + ends[1][axis]));
        let along = (0..3).map(|axis| (ends[1][axis] - ends[0][axis]).powi(2)).sum::<f64>().sqrt();
        let reach = 0.5 * along + 0.65 * self.size + rise;
        let half = (VIEW / 2.0).to_radians();
        let side = SIDES[0] + dice.below(SIDES[1] - SIDES[0] + 1);
        let first = if cameras == 1 { 0.0 } else { dice.within(0.0, TAU) };
        for number in 0..cameras {
            let pitch = if cameras == 1 { dice.within(-5.0, 60.0) } else { dice.within(5.0, 35.0) }.to_radians();
            let around =
                first + (number as f64 + if cameras > 1 { dice.within(-0.2, 0.2) } else { 0.0 }) * TAU / cameras as f64;
            // no camera stands below the floor
            let distance = reach / half.sin() * dice.within(1.02, 1.5);
            let pitch = pitch.max((0.05 - middle[1]) / distance);
            let camera = Camera::around(number as i64, [side; 2], VIEW.to_radians(), middle, distance, [around, pitch]);
            self.cameras.push(camera);
        }
    }

    /// Frames a second.
    pub fn rate(&self) -> f64 {
        1.0 / self.schedule.frame_dt
    }

    /// The angle of view of the cameras \[°\].
    pub fn field_of_view(&self) -> f64 {
        VIEW
    }

    /// Grid spacing of the fit \[m\].
    pub fn spacing(&self) -> f64 {
        self.spacings[0]
    }
}

/// Uniform in the logarithm.
fn between(dice: &mut Dice, [low, high]: [f64; 2]) -> f64 {
    low * (high / low).powf(dice.within(0.0, 1.0))
}

/// To two digits, as a user would give it.
fn rounded(x: f64) -> f64 {
    let digit = 10f64.powf(x.log10().floor() - 1.0);
    (x / digit).round() * digit
}

/// The volume of a body whose longest side is 1, from its field.
pub(super) fn volume(body: &Made) -> f64 {
    let field = body.field();
    let inside = field.nodes.iter().filter(|distance| **distance < 0.0).count();
    inside as f64 * field.spacing.powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clip_follows_from_its_number_and_no_two_are_alike() {
        let of = |split, number, cameras| {
            let Recipe { velocity, parameters, spacings, size, .. } =
                Recipe::draw(split, number, cameras, None).unwrap();
            (velocity, parameters, spacings, size)
        };
        assert_eq!(of(Split::Development, 3, 7), of(Split::Development, 3, 7));
        // the same body and fall, whoever films them
        assert_eq!(of(Split::Development, 3, 7), of(Split::Development, 3, 1));
        assert_ne!(of(Split::Development, 3, 7), of(Split::Development, 8, 7));
        assert_ne!(of(Split::Development, 3, 7), of(Split::Report, 3, 7));
        assert!(Recipe::draw(Split::Report, 0, 0, None).is_err());
    }

    #[test]
    fn a_law_of_one_s_own_is_drawn_from_its_priors() {
        let law = Law::read("../examples/laws/ogden.wgsl").unwrap();
        for number in 0..10 {
            let recipe = Recipe::draw(Split::Development, number, 7, Some(&law)).unwrap();
            assert_eq!((recipe.law.name(), recipe.parameters.len()), ("ogden", 3));
            for parameter in law.parameters() {
                let [low, high] = parameter.prior;
                assert!(
                    (low..=high).contains(&recipe.parameters[parameter.name])
                        && recipe.log_prior.contains_key(parameter.name)
                );
            }
        }
    }

    #[test]
    fn the_simulation_never_has_a_grid_that_the_search_can_choose() {
        for number in 0..20 {
            let recipe = Recipe::draw(Split::Development, number, 7, None).unwrap();
            let share = recipe.spacings[1] / recipe.spacings[0];
            assert!((0.6..=1.4).contains(&share), "{share}");
            assert!((share - 1.0).abs() > 0.039 && (share - 0.7).abs() > 0.039, "{share}");
            let count = volume(&recipe.body) * (2.0 * recipe.size / recipe.spacings[0]).powi(3);
            assert!((850.0..3500.0).contains(&count), "{count} particles");
            assert!(recipe.cameras.iter().all(|camera| camera.centre()[1] > 0.0));
        }
    }
}
