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
        let [r, g, b] = [0, 1, 2].map(|c| median(&mut values.iter().map(|v| v[c]).collect::<Vec<u8>>()));
        [r, g, b, 255]
    };
    Image { width, height, pixels: (0..width * height).into_par_iter().map(pixel).collect(), has_alpha: false }
}
