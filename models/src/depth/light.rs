//! Random light on a surface: a lamp or two, light from everywhere, and a shine.

use crate::views::objects::Dice;

type Vector = [f32; 3];

/// Lamps far away, in the camera's frame.
pub(super) struct Light {
    /// Directions towards the lamps, and their strengths.
    lamps: Vec<(Vector, f32)>,
    up: Vector,
    /// Strength of the light from everywhere; a third of it depends on how far a surface looks up.
    ambient: f32,
    /// Strength and exponent of the shine; a strength of 0 is dull.
    shine: (f32, f32),
    /// Colour of the light.
    pub tint: Vector,
}

/// Probabilities of a second lamp and of a dull surface.
const SECOND: f64 = 0.45;
const DULL: f64 = 0.6;
/// A lamp stands behind the solid by this at most.
const BEHIND: f64 = 0.35;

impl Light {
    /// Draws light that comes rather from above.
    pub fn draw(up: Vector, dice: &mut Dice) -> Self {
        let second = dice.chance(SECOND);
        let strengths = [1.0, dice.within(0.1, 0.6)];
        let lamps = strengths[..1 + usize::from(second)].iter().map(|strength| (towards(up, dice), *strength as f32));
        let lamps = lamps.collect();
        let ambient = dice.within(0.1, 0.6) as f32;
        let shine = if dice.chance(DULL) { 0.0 } else { dice.within(0.0, 0.4) };
        let shine = (shine as f32, dice.within(1.5, 4.0).exp() as f32);
        Self { lamps, up, ambient, shine, tint: [0; 3].map(|_| (0.1 * dice.normal()).exp() as f32) }
    }

    /// Diffuse and specular brightness (Blinn 1977) of a surface with this unit normal, seen along the unit vector `view`
    /// towards the camera.
    pub fn on(&self, normal: Vector, view: Vector) -> [f32; 2] {
        let mut diffuse = self.ambient * (0.65 + 0.35 * dot(normal, self.up));
        let mut specular = 0.0;
        for (lamp, strength) in &self.lamps {
            let facing = dot(normal, *lamp);
            if facing <= 0.0 {
                continue;
            }
            diffuse += strength * facing;
            if self.shine.0 > 0.0 {
                let half = unit([0, 1, 2].map(|k| lamp[k] + view[k]));
                specular += strength * self.shine.0 * dot(half, normal).max(0.0).powf(self.shine.1);
            }
        }
        [diffuse, specular]
    }
}

/// The direction of a lamp: upwards by a random share, and not from behind the solid.
fn towards(up: Vector, dice: &mut Dice) -> Vector {
    loop {
        let share = dice.within(0.0, 1.6);
        let found: [f64; 3] = std::array::from_fn(|k| share * f64::from(up[k]) + 0.7 * dice.normal());
        let length = found.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-9);
        if found[2] <= BEHIND * length {
            return found.map(|x| (x / length) as f32);
        }
    }
}

pub(super) fn dot(a: Vector, b: Vector) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn unit(a: Vector) -> Vector {
    let scale = 1.0 / (dot(a, a) + 1e-20).sqrt();
    a.map(|x| x * scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gradreel::Key;

    #[test]
    fn a_lamp_lights_what_faces_it() {
        let light = Light {
            lamps: vec![([0.0, 0.0, -1.0], 0.5)],
            up: [0.0, -1.0, 0.0],
            ambient: 0.2,
            shine: (0.4, 2.0),
            tint: [1.0; 3],
        };
        let towards = [0.0, 0.0, -1.0];
        // face on: ambient 0.2 · 0.65, lamp 0.5, shine 0.5 · 0.4
        let [diffuse, specular] = light.on(towards, towards);
        assert!((diffuse - 0.63).abs() < 1e-6 && (specular - 0.2).abs() < 1e-6);
        // turned by 60°: half the lamp, and half of the shine's exponent of the cosine
        let turned = [0.75f32.sqrt(), 0.0, -0.5];
        let [diffuse, specular] = light.on(turned, towards);
        assert!((diffuse - 0.38).abs() < 1e-6 && (specular - 0.05).abs() < 1e-6);
        // up, and away from the lamp
        assert_eq!(light.on([0.0, -1.0, 0.0], towards)[0], 0.2);
        assert_eq!(light.on([0.0, 0.0, 1.0], towards)[1], 0.0);
    }

    #[test]
    fn lamps_stand_before_the_solid_and_rather_above() {
        let up = [0.0, -0.8, -0.6];
        let mut above = 0;
        for number in 0..400 {
            let light = Light::draw(up, &mut Dice::new(Key::new(number)));
            for (lamp, _) in &light.lamps {
                assert!((dot(*lamp, *lamp) - 1.0).abs() < 1e-5 && lamp[2] <= BEHIND as f32 + 1e-6);
            }
            above += usize::from(dot(light.lamps[0].0, up) > 0.0);
        }
        assert!(above > 280, "{above} of 400");
    }
}
