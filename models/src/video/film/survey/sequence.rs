//! Small pictures of a film in time order.

use crate::video::image::Image;

/// Red, green and blue.
pub(in crate::video::film) type Rgb = [u8; 3];

/// What lies behind transparent pixels.
const BEHIND: Rgb = [0, 255, 0];

/// Small pictures of equal size with their numbers in the film and their times.
#[derive(Default)]
pub(in crate::video::film) struct Sequence {
    pub width: usize,
    pub height: usize,
    /// Number of each picture in the film.
    pub numbers: Vec<usize>,
    /// Time of each picture \[s\].
    pub times: Vec<f64>,
    pub pictures: Vec<Vec<Rgb>>,
}

impl Sequence {
    /// Adds a picture.
    pub fn push(&mut self, number: usize, seconds: f64, image: &Image) {
        (self.width, self.height) = (image.width, image.height);
        let opaque = |&[r, g, b, a]: &[u8; 4]| match a {
            255 => [r, g, b],
            _ => {
                let mixed = |c: u8, behind: u8| {
                    ((u32::from(c) * u32::from(a) + u32::from(behind) * (255 - u32::from(a)) + 127) / 255) as u8
                };
                [mixed(r, BEHIND[0]), mixed(g, BEHIND[1]), mixed(b, BEHIND[2])]
            }
        };
        self.numbers.push(number);
        self.times.push(seconds);
        self.pictures.push(image.pixels.iter().map(opaque).collect());
    }

    /// A picture of this size.
    pub fn image(&self, pixels: &[Rgb]) -> Image {
        let pixels = pixels.iter().map(|&[r, g, b]| [r, g, b, 255]).collect();
        Image { width: self.width, height: self.height, pixels, has_alpha: false }
    }

    /// Its last pictures.
    pub fn last(&self, count: usize) -> Self {
        let from = self.pictures.len().saturating_sub(count);
        Self {
            width: self.width,
            height: self.height,
            numbers: self.numbers[from..].to_vec(),
            times: self.times[from..].to_vec(),
            pictures: self.pictures[from..].to_vec(),
        }
    }

    /// Shortens the time for which the first picture is held, if it is longer than `held` usual intervals: nobody
    /// knows when in it the action begins.
    pub fn begin_with_motion(&mut self, held: f64) {
        let mut gaps: Vec<f64> = self.times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        if gaps.len() < 2 {
            return;
        }
        let first = gaps[0];
        gaps.sort_by(f64::total_cmp);
        let usual = gaps[gaps.len() / 2];
        if first > held * usual {
            self.times[0] = self.times[1] - usual;
        }
    }
}
