//! What films of phones have that films of a studio have not.

use gradreel::Key;
use serde::{Deserialize, Serialize};

use crate::scenes::{FilmSettings, Object, SceneFile, Shape};
use crate::views::objects::Dice;

/// One of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub(crate) enum Degradation {
    /// A hand holds the object, lets go and stays in the picture
    HandRelease,
    /// It is held for seconds before it is let go, and the film goes on for seconds after
    Waiting,
    /// The camera shakes by a hundredth of the picture's height
    Shake,
    /// An exposure of most of the interval between two pictures
    Blur,
    /// Rows are exposed one after another
    RollingShutter,
    /// Pictures at uneven times
    VariableRate,
    /// Filmed at four times the rate that the file says
    SlowMotion,
    /// H.264 at 2 Mbit/s, for a picture of 1920 × 1080; less for a smaller one
    Compression,
    /// Filmed upright: the file turns the pictures
    Portrait,
    /// Shadows of people wander over the scene
    MovingShadows,
    /// The film goes on for three bounces
    ThreeBounces,
    /// The object spins
    Spin,
    /// A second, smaller object falls beside it
    SecondObject,
}

/// Size of the second object, in those of the first.
const SECOND: f64 = 0.7;

impl Degradation {
    /// All of them.
    pub const ALL: [Self; 13] = [
        Self::HandRelease,
        Self::Waiting,
        Self::Shake,
        Self::Blur,
        Self::RollingShutter,
        Self::VariableRate,
        Self::SlowMotion,
        Self::Compression,
        Self::Portrait,
        Self::MovingShadows,
        Self::ThreeBounces,
        Self::Spin,
        Self::SecondObject,
    ];

    /// Its name in files and options.
    pub fn name(self) -> String {
        let value = clap::ValueEnum::to_possible_value(&self).expect("no variant is skipped");
        value.get_name().to_owned()
    }

    /// Whether a film with it may be refused with the option that decides.
    pub fn may_ask(self) -> bool {
        matches!(self, Self::SlowMotion | Self::SecondObject)
    }

    /// Changes the scene, as far as it is not the film alone that changes.
    pub(super) fn change(self, file: &mut SceneFile, settings: &mut FilmSettings, key: Key) {
        let mut dice = Dice::new(key.fold(1 + self as u64));
        match self {
            // what is held is at rest
            Self::HandRelease | Self::Waiting => {
                for object in &mut file.objects {
                    (object.velocity_m_s, object.spin_rad_s) = ([0.0; 3], [0.0; 3]);
                }
            }
            Self::Portrait => settings.pixels.sort_unstable(),
            // as long again as the fall after each of three hits: enough for what leaves with the speed of the hit
            Self::ThreeBounces => file.time.duration_s *= 2.5,
            Self::Spin => {
                if let Some(object) = file.objects.first_mut() {
                    let rate = dice.within(4.0, 12.0);
                    object.spin_rad_s = dice.direction().map(|x| rate * x);
                }
            }
            Self::SecondObject => {
                if let Some(object) = file.objects.first() {
                    let side = if dice.chance(0.5) { 1.0 } else { -1.0 };
                    let second = beside(object, side * dice.within(2.5, 3.5));
                    file.objects.push(second);
                }
            }
            Self::Shake
            | Self::Blur
            | Self::RollingShutter
            | Self::VariableRate
            | Self::SlowMotion
            | Self::Compression
            | Self::MovingShadows => {}
        }
    }
}

/// A smaller object of the same kind, so many of its radii beside it.
fn beside(object: &Object, radii: f64) -> Object {
    let mut second = Object { colour: Some("#3b7dd8".to_owned()), ..object.clone() };
    let aside = |centre: [f64; 3], radius: f64| [centre[0] + radii * radius, centre[1], centre[2]];
    let radius = |sizes: &[f64]| sizes.iter().fold(0.0, |a: f64, b| a.max(*b));
    match &mut second.shape {
        Shape::Box { centre_m, size_m } => {
            *centre_m = aside(*centre_m, 0.5 * radius(size_m));
            *size_m = size_m.map(|x| SECOND * x);
        }
        Shape::Sphere { centre_m, radius_m } => {
            *centre_m = aside(*centre_m, *radius_m);
            *radius_m *= SECOND;
        }
        Shape::Cylinder { centre_m, radius_m, height_m } | Shape::Cone { centre_m, radius_m, height_m } => {
            *centre_m = aside(*centre_m, radius(&[*radius_m, 0.5 * *height_m]));
            (*radius_m, *height_m) = (SECOND * *radius_m, SECOND * *height_m);
        }
        Shape::Torus { centre_m, ring_radius_m, tube_radius_m } => {
            *centre_m = aside(*centre_m, *ring_radius_m + *tube_radius_m);
            (*ring_radius_m, *tube_radius_m) = (SECOND * *ring_radius_m, SECOND * *tube_radius_m);
        }
        Shape::Mesh { scale, translate_m, .. } | Shape::Particles { scale, translate_m, .. } => {
            *translate_m = aside(*translate_m, *scale);
            *scale *= SECOND;
        }
    }
    second
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phone::scenes::scene;

    #[test]
    fn names_are_read_back() {
        for degradation in Degradation::ALL {
            let name = degradation.name();
            assert_eq!(<Degradation as clap::ValueEnum>::from_str(&name, false), Ok(degradation));
            assert_eq!(serde_json::to_value(degradation).unwrap(), name.as_str());
        }
        assert_eq!(Degradation::ALL.iter().filter(|one| one.may_ask()).count(), 2);
    }

    #[test]
    fn scenes_change_as_the_names_say() {
        let changed = |degradation: Degradation| {
            let mut file = scene(Key::new(3));
            let mut settings = file.film.clone().unwrap();
            degradation.change(&mut file, &mut settings, Key::new(4));
            (file, settings)
        };
        let plain = scene(Key::new(3));
        assert!(crate::vector::norm(changed(Degradation::Spin).0.objects[0].spin_rad_s) >= 4.0);
        assert_eq!(changed(Degradation::SecondObject).0.objects.len(), plain.objects.len() + 1);
        assert!(changed(Degradation::ThreeBounces).0.time.duration_s > 2.0 * plain.time.duration_s);
        let [width, height] = changed(Degradation::Portrait).1.pixels;
        assert!(width <= height);
        assert_eq!(changed(Degradation::HandRelease).0.objects[0].velocity_m_s, [0.0; 3]);
        assert_eq!(changed(Degradation::Blur).0, plain);
    }
}
