//! Poses in which a picture is handed to the network: as it is or mirrored, and moved by whole pixels. Answers are averaged.

use super::features::{CHANNELS, MASK, PLACE};
use super::picture::{PIXELS, SIZE, mirror};

/// A pose of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Pose {
    mirrored: bool,
    /// Pixels to the right and downwards.
    shift: [isize; 2],
}

impl Pose {
    /// As it is, and mirrored.
    pub const MIRRORED: [Self; 2] = [Self::new(false, [0, 0]), Self::new(true, [0, 0])];

    /// Mirrored and moved: the network sees pixels in squares, and says a little else of each place in them. To each pose there is
    /// the one that a mirror makes of it, so that a mirrored picture has the mirrored answer.
    pub const ALL: [Self; 8] = [
        Self::new(false, [0, 0]),
        Self::new(true, [0, 0]),
        Self::new(false, [1, 0]),
        Self::new(true, [-1, 0]),
        Self::new(false, [0, -1]),
        Self::new(true, [0, -1]),
        Self::new(false, [-2, 2]),
        Self::new(true, [2, 2]),
    ];

    const fn new(mirrored: bool, shift: [isize; 2]) -> Self {
        Self { mirrored, shift }
    }

    /// Features of the picture in this pose; `None` if a part of the silhouette would leave the picture.
    pub fn taken(self, features: &[f32]) -> Option<Vec<f32>> {
        let inside = |pixel: usize| features[MASK * PIXELS + pixel] == 0.0 || self.target(pixel).is_some();
        if !(0..PIXELS).all(inside) {
            return None;
        }
        let mut taken = Vec::with_capacity(CHANNELS * PIXELS);
        for channel in 0..CHANNELS {
            let plane = &features[channel * PIXELS..][..PIXELS];
            let sign = if self.mirrored && channel == PLACE { -1.0 } else { 1.0 };
            let mut moved = vec![0.0; PIXELS];
            for (pixel, value) in plane.iter().enumerate() {
                if let Some(target) = self.target(pixel) {
                    moved[target] = sign * value;
                }
            }
            if self.mirrored {
                mirror(&mut moved);
            }
            taken.extend(moved);
        }
        Some(taken)
    }

    /// A map of the picture in this pose as one of the picture itself.
    pub fn back(self, mut map: Vec<f32>) -> Vec<f32> {
        if self.mirrored {
            mirror(&mut map);
        }
        (0..PIXELS).map(|pixel| self.target(pixel).map_or(0.0, |target| map[target])).collect()
    }

    /// The pixel to which a pixel is moved, before it is mirrored.
    fn target(self, pixel: usize) -> Option<usize> {
        let moved = |at: usize, by: isize| at.checked_add_signed(by).filter(|at| *at < SIZE);
        Some(moved(pixel / SIZE, self.shift[1])? * SIZE + moved(pixel % SIZE, self.shift[0])?)
    }
}

#[cfg(test)]
mod tests {
    use gradreel::Key;

    use super::*;

    fn features(low: usize) -> Vec<f32> {
        let inside = |pixel: usize| (low..50).contains(&(pixel % SIZE)) && (10..50).contains(&(pixel / SIZE));
        let values: Vec<f64> = Key::new(1).uniform(CHANNELS * PIXELS).collect();
        let value = |(i, x): (usize, f64)| match (inside(i % PIXELS), i / PIXELS) {
            (false, _) => 0.0,
            (true, MASK) => 1.0,
            _ => x as f32,
        };
        values.into_iter().enumerate().map(value).collect()
    }

    /// What was taken comes back where it was, and the place to the right changes its sign in a mirror.
    #[test]
    fn a_pose_is_undone() {
        let features = features(12);
        for pose in Pose::ALL {
            let taken = pose.taken(&features).unwrap();
            for channel in 0..CHANNELS {
                let sign = if pose.mirrored && channel == PLACE { -1.0 } else { 1.0 };
                let back = pose.back(taken[channel * PIXELS..][..PIXELS].to_vec());
                let same = back.iter().zip(&features[channel * PIXELS..]).all(|(a, b)| *a == sign * b);
                assert!(same, "{pose:?}, channel {channel}");
            }
        }
        assert_ne!(Pose::ALL[2].taken(&features).unwrap(), features);
    }

    #[test]
    fn a_silhouette_stays_in_the_picture() {
        let features = features(1);
        let kept = Pose::ALL.iter().filter(|pose| pose.taken(&features).is_some()).count();
        // a shift by two to the left is too far
        assert_eq!(kept, 7);
    }
}
