//! Grain of films with few colours: a fixed palette represents missing colours by dithering, a pixelwise mixture of
//! the available ones.

use rayon::prelude::*;

use crate::video::image::Image;

/// Minimum difference of a grain pixel from each of its four neighbours. Pixels of edges and textures resemble a
/// neighbour on at least one side.
const STANDS_OUT: u8 = 12;

/// Minimum share of such pixels, and of squares that contain any, in a grainy picture. The latter excludes pictures
/// in which only the object is speckled.
const COARSE: [f64; 2] = [0.02, 0.3];

/// Side of these squares \[pixels\].
const SQUARE: usize = 16;

/// Width of the Gaussian that restores mixed colours \[pixels\].
const WIDTH: f64 = 2.0;

/// The pictures with grain removed; `None` if there is no grain.
pub(super) fn removed(images: &[Image]) -> Option<Vec<Image>> {
    let grained = images.par_iter().any(is_grained);
    (grained && !images.iter().any(Image::is_transparent_somewhere)).then(|| images.par_iter().map(smoothed).collect())
}

/// Whether isolated pixels differ from their surroundings in some channel all over the picture.
fn is_grained(image: &Image) -> bool {
    let Image { width, height, pixels, .. } = image;
    if *width < 3 || *height < 3 {
        return false;
    }
    let stands_out = |i: usize| {
        let around = [i - 1, i + 1, i - width, i + width].map(|j| pixels[j]);
        (0..3).any(|c| {
            let own = pixels[i][c];
            around.iter().all(|p| own.saturating_sub(p[c]) >= STANDS_OUT)
                || around.iter().all(|p| p[c].saturating_sub(own) >= STANDS_OUT)
        })
    };
    let across = width.div_ceil(SQUARE);
    let mut squares = vec![0usize; across * height.div_ceil(SQUARE)];
    for (x, y) in (1..height - 1).flat_map(|y| (1..width - 1).map(move |x| (x, y))) {
        squares[y / SQUARE * across + x / SQUARE] += usize::from(stands_out(y * width + x));
    }
    let share = squares.iter().sum::<usize>() as f64 / (width * height) as f64;
    let hit = squares.iter().filter(|count| **count > 0).count() as f64 / squares.len() as f64;
    share > COARSE[0] && hit > COARSE[1]
}

/// Gaussian smoothing.
fn smoothed(image: &Image) -> Image {
    let reach = (3.0 * WIDTH).ceil() as isize;
    let weights: Vec<f32> = (-reach..=reach).map(|d| (-0.5 * (d as f64 / WIDTH).powi(2)).exp() as f32).collect();
    let (width, height) = (image.width as isize, image.height as isize);
    let mean = |from: &[[f32; 3]], x: isize, y: isize, [dx, dy]: [isize; 2]| {
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for (weight, d) in weights.iter().zip(-reach..=reach) {
            let (x, y) = (x + d * dx, y + d * dy);
            if (0..width).contains(&x) && (0..height).contains(&y) {
                let value = from[(y * width + x) as usize];
                (0..3).for_each(|c| sum[c] += weight * value[c]);
                total += weight;
            }
        }
        sum.map(|s| s / total)
    };
    let along = |from: &[[f32; 3]], step: [isize; 2]| -> Vec<[f32; 3]> {
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| mean(from, x, y, step)).collect()
    };
    let values: Vec<[f32; 3]> = image.pixels.iter().map(|p| [p[0], p[1], p[2]].map(f32::from)).collect();
    let mixed = along(&along(&values, [1, 0]), [0, 1]);
    let pixels = mixed.into_iter().map(|[r, g, b]| {
        let [r, g, b] = [r, g, b].map(|v| v.round() as u8);
        [r, g, b, 255]
    });
    Image { pixels: pixels.collect(), ..image.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(value: impl Fn(usize, usize) -> u8) -> Image {
        let pixels = (0..40 * 40).map(|i| [value(i % 40, i / 40), 100, 100, 255]).collect();
        Image { width: 40, height: 40, pixels, has_alpha: false }
    }

    #[test]
    fn a_checkerboard_becomes_what_it_stands_for() {
        let edge = |x: usize, y: usize| if x < 20 { 80 * ((x + y) % 2) as u8 } else { 200 };
        let found = removed(&[picture(edge)]).expect("it is grained");
        for (x, wanted) in [(10, 40), (30, 200)] {
            assert!(found[0].pixels[20 * 40 + x][0].abs_diff(wanted) <= 1, "{:?}", found[0].pixels[20 * 40 + x]);
        }
        assert_eq!(found[0].pixels[5][1..], [100, 100, 255]);
    }

    #[test]
    fn a_texture_is_left_as_it_is() {
        assert!(removed(&[picture(|_, _| 255)]).is_none());
        assert!(removed(&[picture(|x, _| (5 * x) as u8)]).is_none());
        // a speckled object in one place is no grain either
        assert!(removed(&[picture(|x, y| if x < 12 && y < 12 { 80 * ((x + y) % 2) as u8 } else { 200 })]).is_none());
        assert!(removed(&[picture(|x, y| 90 + ((x / 3 + y) % 4) as u8)]).is_none());
    }
}
