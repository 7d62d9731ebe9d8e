//! What stands around a scene: floor and wall with a lamp, pictures on the wall, and shadows that wander.

use gradreel::Key;

use crate::scenes::Paint;
use crate::video::Camera;
use crate::views::objects::Dice;

/// Number of pictures on the wall.
const POSTERS: usize = 7;
/// Share of the light that a wandering shadow takes.
const DARKER: f64 = 0.3;

/// A rectangle on the wall, in the angles under which it is seen \[rad\].
struct Poster {
    middle: [f64; 2],
    half: [f64; 2],
    colour: [f64; 3],
}

/// A shadow that wanders, in heights of the picture.
struct Wanderer {
    from: [f64; 2],
    speed: [f64; 2],
    radius: f64,
}

/// The surroundings of a scene.
pub(super) struct Scenery {
    pub paint: Paint,
    posters: Vec<Poster>,
    wanderers: Vec<Wanderer>,
    /// Height of the floor \[m\].
    floor: f64,
}

impl Scenery {
    /// Surroundings before a camera.
    pub fn draw(key: Key, camera: &Camera, floor: f64, has_shadows: bool) -> Self {
        let [paint, wall, shadows] = key.split();
        let mut dice = Dice::new(wall);
        let ahead = angles(camera.ray(camera.cx, camera.cy).1);
        let wide = (camera.width as f64 / camera.fx).max(camera.height as f64 / camera.fy);
        let posters = (0..POSTERS).map(|_| {
            let middle = [0, 1].map(|k| ahead[k] + wide * dice.within(-0.6, 0.6));
            let half = [0; 2].map(|_| wide * dice.within(0.02, 0.14));
            Poster { middle, half, colour: dice.three(0.05, 0.95) }
        });
        let posters = posters.collect();
        let mut dice = Dice::new(shadows);
        let wanderers = (0..if has_shadows { 2 } else { 0 }).map(|_| Wanderer {
            from: [dice.within(-0.8, 0.8), dice.within(-0.4, 0.4)],
            speed: [dice.within(-0.6, 0.6), dice.within(-0.1, 0.1)],
            radius: dice.within(0.15, 0.4),
        });
        Self { paint: Paint::draw(paint), posters, wanderers: wanderers.collect(), floor }
    }

    /// Where a ray meets the floor \[m\], if it does.
    pub fn foot(&self, origin: [f64; 3], along: [f64; 3]) -> Option<[f64; 3]> {
        let foot = Paint::foot([origin[0], origin[1] - self.floor, origin[2]], along)?;
        Some([foot[0], foot[1] + self.floor, foot[2]])
    }

    /// The colour of what a ray that misses the floor meets.
    pub fn wall(&self, along: [f64; 3]) -> [f64; 3] {
        let at = angles(along);
        let covers = |poster: &&Poster| [0, 1].iter().all(|&k| (at[k] - poster.middle[k]).abs() < poster.half[k]);
        match self.posters.iter().find(covers) {
            // a frame around it
            Some(poster) => {
                let rim = [0, 1].iter().any(|&k| (at[k] - poster.middle[k]).abs() > 0.85 * poster.half[k]);
                if rim { poster.colour.map(|c| 0.4 * c) } else { poster.colour }
            }
            None => self.paint.wall(along),
        }
    }

    /// Share of the light that wandering shadows leave at a pixel, which is given from the picture's middle in heights.
    pub fn left(&self, at: [f64; 2], seconds: f64) -> f64 {
        let one = |wanderer: &Wanderer| {
            let off = [0, 1].map(|k| at[k] - wanderer.from[k] - wanderer.speed[k] * seconds);
            // upright, and soft at the edge
            let distance = off[0].hypot(0.5 * off[1]) / wanderer.radius;
            1.0 - DARKER / (1.0 + (8.0 * (distance - 1.0)).exp())
        };
        self.wanderers.iter().map(one).product()
    }
}

/// Azimuth and elevation of a direction \[rad\].
fn angles(along: [f64; 3]) -> [f64; 2] {
    [along[0].atan2(-along[2]), along[1].atan2(along[0].hypot(along[2]))]
}
