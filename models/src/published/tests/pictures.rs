//! What the model is shown, and where its views belong.

use gradreel::Tensor;

use super::scene::{ball, falling, film, sizes};
use crate::published::pictures::{Pictures, of_planes};
use crate::published::{Path, Placing, Rig, boxes};
use crate::video::{Camera, Frame};
use crate::views::ImageBox;

const FRAMES: usize = 8;

fn of_pictures<T>(test: impl Fn(&Pictures<'_>) -> T) -> T {
    let film = film(FRAMES);
    let boxes = boxes::of_masks(&film).unwrap();
    let path = Path::of_boxes(&film, &boxes).unwrap();
    let rig = Rig::around(&sizes(true).denoiser.ring, &film.cameras[0], &path);
    test(&Pictures { film: &film, boxes: &boxes, path: &path, rig: &rig })
}

/// The box of what is not white in a picture `[1, 3, s, s]`.
fn seen_in(picture: &Tensor) -> ImageBox {
    ImageBox::of_picture(picture).unwrap().unwrap()
}

fn off(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[test]
fn the_module_is_told_where_the_picture_has_the_object() {
    of_pictures(|pictures| {
        let sizes = crate::views::ModelSizes::small();
        for frame in 0..FRAMES {
            let shown = pictures.shown(frame, &sizes, Placing::Module).unwrap();
            let told = shown.seen.unwrap();
            let there = seen_in(&shown.picture);
            assert!(off(told.bounds.centre(), there.centre()) < 1.5 / 64.0, "frame {frame}: {told:?}, {there:?}");
            assert!(told.bounds.overlap(&there) > 0.6, "frame {frame}: {told:?}, {there:?}");
            // near the model's cameras' distance from the middle
            assert!((told.depth.unwrap() - 1.5).abs() < 0.5, "{told:?}");
        }
    });
}

#[test]
fn a_centred_object_is_in_the_middle_and_alike_in_all_frames() {
    of_pictures(|pictures| {
        let sizes = crate::views::ModelSizes::small();
        for frame in 0..FRAMES {
            let shown = pictures.shown(frame, &sizes, Placing::Moved).unwrap();
            assert!(shown.seen.is_none());
            let there = seen_in(&shown.picture);
            assert!(off(there.centre(), [0.5; 2]) < 1.5 / 64.0, "frame {frame}: {there:?}");
            // the model's crop: half of the picture
            assert!((there.high[0] - there.low[0] - 0.5).abs() < 0.06, "frame {frame}: {there:?}");
        }
    });
}

/// Views of a centred ball, moved, are those that the ring's cameras have of the ball on its path.
#[test]
fn moved_views_are_where_the_film_has_the_object() {
    of_pictures(|pictures| {
        let sizes = crate::views::ModelSizes { denoiser: sizes(false).denoiser, ..crate::views::ModelSizes::small() };
        let size = sizes.image;
        let cameras: Vec<Camera> = pictures.cameras(&sizes, Placing::Moved).unwrap();
        assert_eq!(cameras.len(), 4);
        // a disc of the crop's size in the middle, from every side
        let disc = |i: usize| {
            let (x, y) = (i % size, i / size % size);
            let from = (x as f64 + 0.5 - 32.0).hypot(y as f64 + 0.5 - 32.0);
            if from < 16.0 { -0.5f32 } else { 1.0 }
        };
        let views = Tensor::from_vec((0..4 * 3 * size * size).map(disc).collect(), [4, 3, size, size]);
        for frame in [0, FRAMES - 1] {
            let placed = pictures.views(frame, &views, &sizes, Placing::Moved).unwrap();
            for (camera, found) in cameras.iter().zip(&placed) {
                let wanted = boxes::of_frame(&ball(camera, falling(frame))).unwrap();
                let found = boxes::of_frame(found).unwrap();
                assert!(off(found.centre(), wanted.centre()) < 0.03, "{found:?} for {wanted:?}");
                assert!(found.overlap(&wanted) > 0.7, "{found:?} for {wanted:?}");
            }
        }
    });
}

#[test]
fn the_module_is_used_where_there_is_one_and_the_object_is_large_enough() {
    of_pictures(|pictures| {
        assert_eq!(pictures.placing(&sizes(true), true), Placing::Module);
        assert_eq!(pictures.placing(&sizes(true), false), Placing::Moved);
        assert_eq!(pictures.placing(&sizes(false), true), Placing::Moved);
        let mut tiny = pictures.path.clone();
        tiny.radii.iter_mut().for_each(|radius| *radius *= 0.1);
        assert_eq!(Pictures { path: &tiny, ..*pictures }.placing(&sizes(true), true), Placing::Moved);
    });
}

#[test]
fn what_is_not_white_is_the_object() {
    let values = [1.0f32, 0.95, 0.0, -1.0].repeat(3);
    let frames: Vec<Frame> = of_planes(&Tensor::from_vec(values, [1, 3, 2, 2])).unwrap();
    let alpha: Vec<f32> = frames[0].alpha.iter().copied().collect();
    assert_eq!((alpha[0], alpha[1], alpha[2], alpha[3]), (0.0, 0.0, 1.0, 1.0));
    assert_eq!((frames[0].rgb[[0, 1, 0]], frames[0].rgb[[1, 1, 0]]), (1.0, 0.0));
    assert!(of_planes(&Tensor::from_vec(vec![0.0f32; 4], [4])).is_err());
}
