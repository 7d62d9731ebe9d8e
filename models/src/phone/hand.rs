//! A hand that holds an object and lets go.

use crate::vector::{dot, minus, norm, plus, scaled};

/// Radius of a palm, a finger and a forearm \[m\].
const RADII: [f64; 3] = [0.045, 0.011, 0.032];
/// Length of the forearm that is drawn \[m\].
const ARM: f64 = 0.9;
/// Speed with which the hand goes back \[m/s\], and how far \[m\].
const BACK: (f64, f64) = (0.6, 0.18);
/// Time in which it gathers that speed \[s\].
const OPENING: f64 = 0.12;

/// A ball of the hand.
#[derive(Clone, Copy)]
pub(super) struct Ball {
    centre: [f64; 3],
    radius: f64,
    /// Whether it is between the camera and the object.
    pub is_before: bool,
}

/// A hand above an object.
pub(super) struct Hand {
    balls: Vec<Ball>,
    /// From the object along the arm, of length 1.
    along: [f64; 3],
    pub colour: [f64; 3],
}

impl Hand {
    /// A hand that holds a ball of this centre and radius \[m\], seen along `forward`; the arm comes from the `side`.
    pub fn new(centre: [f64; 3], radius: f64, forward: [f64; 3], side: [f64; 3]) -> Self {
        let along = plus(scaled(side, 0.75), [0.0, 0.66, 0.0]);
        let along = scaled(along, 1.0 / norm(along));
        let palm = plus(centre, scaled(along, radius + 0.6 * RADII[0]));
        let mut balls = vec![Ball { centre: palm, radius: RADII[0], is_before: false }];
        let count = (ARM / RADII[2]).ceil() as usize;
        balls.extend((1..=count).map(|k| Ball {
            centre: plus(palm, scaled(along, k as f64 * RADII[2])),
            radius: RADII[2],
            is_before: false,
        }));
        // fingers lie on the near side of the object's upper half
        for finger in 0..4 {
            let across = scaled(side, (f64::from(finger) - 1.5) * 2.0 * RADII[1]);
            for joint in 0..5 {
                let angle = 0.25 * f64::from(joint);
                let out = plus(scaled(along, angle.cos()), scaled(forward, -angle.sin()));
                let centre = plus(plus(centre, across), scaled(out, radius + RADII[1]));
                balls.push(Ball { centre, radius: RADII[1], is_before: true });
            }
        }
        Self { balls, along, colour: [0.78, 0.58, 0.47] }
    }

    /// The balls so long after it lets go \[s\]; before, it holds still.
    pub fn at(&self, seconds: f64) -> Vec<Ball> {
        let t = seconds.max(0.0);
        let way = if t < OPENING { 0.5 * BACK.0 / OPENING * t * t } else { BACK.0 * (t - 0.5 * OPENING) };
        let shift = scaled(self.along, way.min(BACK.1));
        self.balls.iter().map(|ball| Ball { centre: plus(ball.centre, shift), ..*ball }).collect()
    }
}

impl Ball {
    /// Distance along a ray, in lengths of its direction, and the normal there.
    pub fn hit(&self, origin: [f64; 3], along: [f64; 3]) -> Option<(f64, [f64; 3])> {
        let from = minus(origin, self.centre);
        let (a, b) = (dot(along, along), dot(from, along));
        let rest = b * b - a * (dot(from, from) - self.radius * self.radius);
        let t = (-b - rest.max(0.0).sqrt()) / a;
        (rest > 0.0 && t > 0.0).then(|| {
            let out = plus(from, scaled(along, t));
            (t, scaled(out, 1.0 / self.radius))
        })
    }

    /// Lower and upper corner of the box around it \[m\].
    pub fn bounds(&self) -> [[f64; 3]; 2] {
        [-1.0, 1.0].map(|sign| self.centre.map(|x| x + sign * self.radius))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hand_goes_back_and_stays() {
        let hand = Hand::new([0.0; 3], 0.05, [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]);
        let palm = |t: f64| hand.at(t)[0].centre;
        assert_eq!(palm(-1.0), palm(0.0));
        let way = |t: f64| norm(minus(palm(t), palm(0.0)));
        assert!(way(0.05) < way(0.1) && way(0.1) < way(0.3));
        assert!((way(1.0) - BACK.1).abs() < 1e-12 && (way(2.0) - BACK.1).abs() < 1e-12);
        // the palm and the fingers touch the object, and none reaches into it
        let distances: Vec<f64> = hand.at(0.0).iter().map(|ball| norm(ball.centre) - ball.radius).collect();
        assert!(distances.iter().all(|d| *d > 0.02));
        assert!(distances.iter().any(|d| *d < 0.055));
    }

    #[test]
    fn rays_meet_the_near_side() {
        let ball = Ball { centre: [0.0, 0.0, -2.0], radius: 0.5, is_before: false };
        let (t, normal) = ball.hit([0.0; 3], [0.0, 0.0, -0.5]).unwrap();
        assert!((t - 3.0).abs() < 1e-12 && (normal[2] - 1.0).abs() < 1e-12);
        assert!(ball.hit([0.0; 3], [0.0, 1.0, 0.0]).is_none() && ball.hit([0.0; 3], [0.0, 0.0, 1.0]).is_none());
    }
}
