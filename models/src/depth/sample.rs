//! Training samples: features of a random picture, and the depths that belong to it.

use gradreel::Key;

use super::Solid;
use super::camera::{Attitude, Scene, Stretch};
use super::features::Features;
use super::picture::{FEWEST, PIXELS, Picture, SIZE};
use crate::views::objects::Dice;

/// A picture's features with its true depths.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sample {
    /// The planes that the network sees: `CHANNELS · SIZE²` numbers.
    pub features: Vec<f32>,
    /// Front and back in diameters, measured from the body's middle away from the camera; 0 where `weights` is.
    pub depths: [Vec<f32>; 2],
    /// 1 where the solid is and the silhouette says so, else 0.
    pub weights: Vec<f32>,
    /// Tangent of the angle under which a diameter is seen: the diameter in units of the middle's distance.
    pub angle: f32,
}

/// How samples are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// For training: stretched and mirrored solids, wrong silhouettes, missing colours.
    Training,
    /// For validation and reports: solids as they are.
    Exact(Attitude),
}

/// Share of training samples without colours, and the pictures tried of a solid.
const COLOURLESS: f64 = 0.15;
const TRIES: u64 = 4;

impl Sample {
    /// A sample of a solid by a key; `None` if it is hardly seen from anywhere that was tried.
    pub fn draw(solid: &Solid, key: Key, kind: Kind) -> Option<Self> {
        (0..TRIES).find_map(|turn| Self::once(solid, &mut Dice::new(key.fold(turn)), kind))
    }

    fn once(solid: &Solid, dice: &mut Dice, kind: Kind) -> Option<Self> {
        let rough = kind == Kind::Training;
        let (attitude, stretch) = match kind {
            Kind::Exact(attitude) => (attitude, Stretch::None),
            Kind::Training if dice.chance(0.5) => (Attitude::Upright, Stretch::Random),
            Kind::Training => (Attitude::Free, Stretch::Random),
        };
        let scene = Scene::draw(solid, attitude, stretch, SIZE, dice);
        let picture = Picture::draw(&scene, solid, rough, dice)?;
        let picture = if rough && dice.chance(0.5) { picture.mirrored() } else { picture };
        let mut sample = Self::of(&picture)?;
        if rough && dice.chance(COLOURLESS) {
            let mut bare = Features { planes: sample.features, diameter: 0.0 };
            bare.without_colours();
            sample.features = bare.planes;
        }
        Some(sample)
    }

    /// The sample of a picture; `None` if silhouette and solid hardly overlap.
    fn of(picture: &Picture) -> Option<Self> {
        let features = Features::of(std::array::from_fn(|k| &*picture.colours[k]), &picture.given);
        let weights: Vec<f32> =
            picture.given.iter().zip(&picture.solid).map(|(a, b)| f32::from(u8::from(*a && *b))).collect();
        let inside: Vec<usize> = (0..PIXELS).filter(|pixel| weights[*pixel] > 0.0).collect();
        if inside.len() < FEWEST {
            return None;
        }
        let [near, far] = &picture.depths;
        // the middle, weighted by thickness
        let thickness = |pixel: usize| f64::from((far[pixel] - near[pixel]).max(0.0)) + 1e-4;
        let total: f64 = inside.iter().map(|&pixel| thickness(pixel)).sum();
        let middle = |pixel: usize| 0.5 * (f64::from(near[pixel]) + f64::from(far[pixel]));
        let distance = (inside.iter().map(|&pixel| thickness(pixel) * middle(pixel)).sum::<f64>() / total) as f32;
        let angle = features.diameter * picture.pixel;
        let mut depths = [0; 2].map(|_| vec![0.0; PIXELS]);
        for &pixel in &inside {
            for (own, depth) in depths.iter_mut().zip(&picture.depths) {
                own[pixel] = (depth[pixel] - distance) / (angle * distance);
            }
        }
        Some(Self { features: features.planes, depths, weights, angle })
    }
}

/// Key folds that separate the draws of a training sample.
const WHICH: u64 = 0;
const SEEN: u64 = 1;

/// The training sample of a key: of a real solid, or with the probability `share` of a procedural one.
pub(crate) fn training_sample(key: Key, real: &[impl AsRef<Solid>], made: &[impl AsRef<Solid>], share: f64) -> Sample {
    let draw = |turn: u64| {
        let key = key.fold(turn);
        let mut dice = Dice::new(key.fold(WHICH));
        let of_made = dice.chance(share) && !made.is_empty();
        let count = if of_made { made.len() } else { real.len() };
        let place = dice.below(count);
        let solid = if of_made { made[place].as_ref() } else { real[place].as_ref() };
        Sample::draw(solid, key.fold(SEEN), Kind::Training)
    };
    (0..).find_map(draw).expect("some solid can be seen")
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::depth::features::{HALF, MASK, PLACE};
    use crate::depth::testing::{ball, boxed};

    fn solids() -> Vec<Arc<Solid>> {
        vec![Arc::new(boxed([0.5, 0.2, 0.3])), Arc::new(ball(0.5, 24)), Arc::new(boxed([0.1, 0.4, 0.5]))]
    }

    /// The depths of a ball in closed form: in diameters, front and back are `∓√(1/4 − ρ²)` for a ball far away.
    #[test]
    fn depths_of_a_ball_are_those_of_the_formula() {
        let solid = ball(0.5, 96);
        for number in 0..8 {
            let sample = Sample::draw(&solid, Key::new(number), Kind::Exact(Attitude::Free)).unwrap();
            let mut worst = 0.0f32;
            for pixel in 0..PIXELS {
                let [x, y] = [0, 1].map(|k| sample.features[(PLACE + k) * PIXELS + pixel]);
                let rest = 0.25 - x * x - y * y;
                if sample.weights[pixel] > 0.0 && rest > 0.04 {
                    let half = rest.sqrt();
                    let [front, back] = [0, 1].map(|k| sample.depths[k][pixel]);
                    worst = worst.max((front + half).abs()).max((back - half).abs());
                    assert!((sample.features[HALF * PIXELS + pixel] - half).abs() < 0.05);
                }
            }
            // the perspective of a camera two radii away moves the surfaces by less than a fifth of a diameter
            assert!(worst < 0.2, "{worst}");
        }
    }

    #[test]
    fn depths_have_their_middle_at_zero() {
        for number in 0..30 {
            let sample = training_sample(Key::new(number), &solids(), &solids(), 0.2);
            let [front, back] = &sample.depths;
            let (mut sum, mut total) = (0.0, 0.0);
            for pixel in 0..PIXELS {
                let weight = sample.weights[pixel] * (back[pixel] - front[pixel]);
                sum += weight * (front[pixel] + back[pixel]);
                total += weight;
                assert!(sample.weights[pixel] == 0.0 || front[pixel] <= back[pixel]);
                assert!(sample.weights[pixel] <= sample.features[MASK * PIXELS + pixel]);
            }
            assert!((sum / total).abs() < 0.01, "{}", sum / total);
            assert!((0.05..1.5).contains(&sample.angle));
        }
    }

    /// Pictures of different steps and places differ, and a key gives the same one again.
    #[test]
    fn no_picture_repeats() {
        let key = Key::new(0);
        let draw = |step: u64, place: u64| training_sample(key.fold(step).fold(place), &solids(), &solids(), 0.2);
        let mut seen = std::collections::BTreeSet::new();
        for step in 0..40 {
            for place in 0..8 {
                let sample = draw(step, place);
                let bits: Vec<u32> = sample.features.iter().map(|x| x.to_bits()).collect();
                let colourless = sample.features[..3 * PIXELS].iter().all(|x| *x == 0.0);
                let depths: Vec<u32> = sample.depths[0].iter().map(|x| x.to_bits()).collect();
                assert!(colourless || seen.insert(bits), "step {step}, place {place}");
                assert!(seen.insert(depths), "the depths of step {step}, place {place}");
            }
        }
        assert_eq!(draw(7, 3), draw(7, 3));
    }
}
