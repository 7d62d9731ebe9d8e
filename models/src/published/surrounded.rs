//! The film with its views around it, as one clip.

use crate::video::{Camera, Clip, Foreground, Frame};

/// The clip of the film's camera and those of its views, which nobody filmed with: `views[frame][view]`.
pub(super) fn surrounded(film: &Clip, cameras: Vec<Camera>, views: Vec<Vec<Frame>>) -> Clip {
    let count = cameras.len();
    let mut columns: Vec<Vec<Frame>> = (0..count).map(|_| Vec::with_capacity(views.len())).collect();
    for frame in views {
        frame.into_iter().zip(&mut columns).for_each(|(view, column)| column.push(view));
    }
    Clip {
        cameras: film.cameras.iter().cloned().chain(cameras).collect(),
        frames: film.frames.iter().cloned().chain(columns).collect(),
        foreground: film.foreground.iter().copied().chain(vec![Foreground::White; count]).collect(),
        imagined: film.imagined.iter().copied().chain(vec![true; count]).collect(),
        // all around, nothing is known by the fall alone
        flight: None,
        around: None,
        story: None,
        ..film.clone()
    }
}
