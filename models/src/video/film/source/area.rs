//! Shrinking by area averages: each pixel is the mean of what it covers.

use crate::video::image::Image;

/// Width and height of a picture of `size` whose longer side is at most `longer`; never more than `size`.
pub(in crate::video::film) fn within((width, height): (usize, usize), longer: usize) -> (usize, usize) {
    let most = width.max(height);
    if most <= longer {
        return (width, height);
    }
    let side = |side: usize| ((side as f64 * longer as f64 / most as f64).round() as usize).max(1);
    (side(width), side(height))
}

/// The input samples that an output sample covers: index of the first, and their shares, whose sum is 1.
struct Cover {
    first: usize,
    shares: Vec<f32>,
}

/// The cover of each of `to` samples that divide `from` samples evenly.
fn covers(from: usize, to: usize) -> Vec<Cover> {
    let scale = from as f64 / to as f64;
    let one = |i: usize| {
        let (begin, end) = (i as f64 * scale, ((i + 1) as f64 * scale).min(from as f64));
        let (first, last) = (begin.floor() as usize, (end.ceil() as usize).clamp(1, from));
        let share = |k: usize| (end.min((k + 1) as f64) - begin.max(k as f64)).max(0.0);
        Cover { first, shares: (first..last.max(first + 1)).map(|k| (share(k) / (end - begin)) as f32).collect() }
    };
    (0..to).map(one).collect()
}

/// A picture at a smaller size. Colours are weighted by alpha.
pub(in crate::video::film) fn shrunk(image: Image, (width, height): (usize, usize)) -> Image {
    if (image.width, image.height) == (width, height) {
        return image;
    }
    let (across, down) = (covers(image.width, width), covers(image.height, height));
    let mut pixels = Vec::with_capacity(width * height);
    let mut sums = vec![[0.0f32; 4]; width];
    for rows in &down {
        sums.fill([0.0; 4]);
        for (row, share) in image.pixels[rows.first * image.width..].chunks_exact(image.width).zip(&rows.shares) {
            for (sum, columns) in sums.iter_mut().zip(&across) {
                for (pixel, column) in row[columns.first..].iter().zip(&columns.shares) {
                    let weight = share * column * f32::from(pixel[3]);
                    (0..3).for_each(|c| sum[c] += weight * f32::from(pixel[c]));
                    sum[3] += weight;
                }
            }
        }
        let pixel = |[r, g, b, alpha]: &[f32; 4]| {
            let colour = |sum: &f32| if *alpha > 0.0 { (sum / alpha).round() as u8 } else { 0 };
            [colour(r), colour(g), colour(b), alpha.round() as u8]
        };
        pixels.extend(sums.iter().map(pixel));
    }
    Image { width, height, pixels, has_alpha: image.has_alpha }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_is_the_mean_of_what_it_covers() {
        let line = |values: &[u8]| Image {
            width: values.len(),
            height: 1,
            pixels: values.iter().map(|v| [*v, 0, 255, 255]).collect(),
            has_alpha: false,
        };
        // each of two covers one and a half: (30 + 60 / 2) / 1.5 and (60 / 2 + 90) / 1.5
        let half = shrunk(line(&[30, 60, 90]), (2, 1));
        assert_eq!(half.pixels, [[40, 0, 255, 255], [80, 0, 255, 255]]);
        assert_eq!(shrunk(line(&[10, 20, 30, 40]), (1, 1)).pixels, [[25, 0, 255, 255]]);
        let mut image = line(&[200, 100]);
        image.pixels[1][3] = 0;
        assert_eq!(shrunk(image, (1, 1)).pixels, [[200, 0, 255, 128]], "what is not there lends no colour");
    }

    #[test]
    fn sizes_keep_their_shape_and_are_never_enlarged() {
        assert_eq!(within((1920, 1080), 640), (640, 360));
        assert_eq!(within((172, 1716), 640), (64, 640));
        assert_eq!(within((300, 200), 640), (300, 200));
        assert_eq!(within((9000, 1), 640), (640, 1));
    }
}
