//! The background behind the object, from pictures in which the survey says that the object is elsewhere.

use rayon::prelude::*;

use super::chosen::Chosen;
use super::median::median;
use super::survey::Survey;
use crate::video::image::Image;

/// A picture, and where the object is in it: left, top, right and bottom.
type Seen<'a> = (&'a Image, Option<[f64; 4]>);

/// The background plate of the chosen pictures.
pub(super) fn of(chosen: &Chosen, survey: &Survey, scale: f64) -> Image {
    let covered = |number: usize| survey.window(number).map(|rect| rect.map(|v| v * scale));
    let own = chosen.images.iter().zip(&chosen.numbers).map(|(image, number)| (image, covered(*number)));
    let beside = chosen.beside.iter().map(|(number, image)| (image, covered(*number)));
    let seen: Vec<Seen<'_>> = own.chain(beside).collect();
    let (width, height) = (seen[0].0.width, seen[0].0.height);
    let pixel = |i: usize| {
        let [x, y] = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
        let free = |(_, rect): &&Seen<'_>| {
            rect.is_none_or(|[left, top, right, bottom]| !((left..right).contains(&x) && (top..bottom).contains(&y)))
        };
        let mut values: Vec<[u8; 4]> = seen.iter().filter(free).map(|(image, _)| image.pixels[i]).collect();
        if values.is_empty() {
            values = seen.iter().map(|(image, _)| image.pixels[i]).collect();
        }
        let [r, g, b] = lit(&values);
        [r, g, b, 255]
    };
    Image { width, height, pixels: (0..width * height).into_par_iter().map(pixel).collect(), has_alpha: false }
}

/// Least ratio of the brightness of a place to that in a shadow, least share of the pictures that show it lit, and largest difference of
/// the logarithms of that ratio between the channels.
const SHADOW: f64 = 1.12;
const LEAST_LIT: f64 = 0.15;
const SAME_HUE: f64 = 0.06;

/// The colour of a place: the median, or that of the brighter pictures where the others show it in a shadow, darker in the same hue.
fn lit(values: &[[u8; 4]]) -> [u8; 3] {
    let middle = |values: &[[u8; 4]]| [0, 1, 2].map(|c| median(&mut values.iter().map(|v| v[c]).collect::<Vec<u8>>()));
    let sum = |v: &[u8]| v[..3].iter().map(|x| f64::from(*x)).sum::<f64>();
    let usual = middle(values);
    let brighter: Vec<[u8; 4]> = values.iter().filter(|v| sum(&v[..]) > SHADOW * sum(&usual)).copied().collect();
    if (brighter.len() as f64) < (LEAST_LIT * values.len() as f64).max(2.0) {
        return usual;
    }
    let bright = middle(&brighter);
    let ratios = [0, 1, 2].map(|c| (f64::from(bright[c].max(1)) / f64::from(usual[c].max(1))).ln());
    let mean = ratios.iter().sum::<f64>() / 3.0;
    if ratios.iter().all(|ratio| (ratio - mean).abs() < SAME_HUE) { bright } else { usual }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_seen_lit() {
        let of = |parts: &[(usize, [u8; 3])]| -> Vec<[u8; 4]> {
            parts.iter().flat_map(|(n, [r, g, b])| std::iter::repeat_n([*r, *g, *b, 255], *n)).collect()
        };
        // in a shadow most of the time
        assert_eq!(lit(&of(&[(8, [60, 50, 40]), (4, [120, 100, 80])])), [120, 100, 80]);
        // something red was there for a while, or something bright in a single picture
        assert_eq!(lit(&of(&[(8, [60, 50, 40]), (4, [200, 60, 40])])), [60, 50, 40]);
        assert_eq!(lit(&of(&[(12, [60, 50, 40]), (1, [120, 100, 80])])), [60, 50, 40]);
        // noise
        assert_eq!(lit(&of(&[(4, [60, 50, 40]), (5, [62, 51, 41]), (4, [64, 52, 43])])), [62, 51, 41]);
    }
}
