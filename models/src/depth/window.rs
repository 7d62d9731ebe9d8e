//! A masked picture of any size, and the window of it that the network sees.

use gradreel::{Error, ErrorKind, Result};

use super::picture::{FEWEST, PIXELS, SIZE};

/// Colours and the coverage by a body of each pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct MaskedPicture {
    width: usize,
    height: usize,
    colours: Vec<[f32; 3]>,
    coverage: Vec<f32>,
}

/// Where the square maps of a prediction lie in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Left upper corner in pixels of the picture.
    pub corner: [f64; 2],
    /// Side of a pixel of the maps, in pixels of the picture.
    pub pixel: f64,
}

/// The picture in its window.
pub(super) struct Framed {
    pub colours: [Vec<f32>; 3],
    pub silhouette: Vec<bool>,
    pub window: Window,
}

/// Share of the window's side that the longer side of the silhouette takes.
const FILLED: f64 = 0.75;
/// Coverage from which a pixel is the body's.
const INSIDE: f32 = 0.5;
/// Samples along the side of a pixel of the maps where the picture is finer, at most.
const FINEST: f64 = 16.0;

impl Window {
    /// The pixel of the maps at a place of the picture.
    pub(super) fn pixel_at(&self, x: f64, y: f64) -> Option<usize> {
        let [column, row] = [(x, 0), (y, 1)].map(|(at, axis)| (at - self.corner[axis]) / self.pixel);
        let inside = |at: f64| (0.0..SIZE as f64).contains(&at);
        (inside(column) && inside(row)).then(|| row as usize * SIZE + column as usize)
    }
}

impl MaskedPicture {
    /// A picture of rows of pixels: colours as a screen shows them, 0 to 1, and the share of each pixel that the body covers.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for other than `width · height` colours and coverages, and for numbers outside 0 to 1.
    pub fn new(width: usize, height: usize, colours: Vec<[f32; 3]>, coverage: Vec<f32>) -> Result<Self> {
        let count = width.checked_mul(height).filter(|count| *count > 0);
        if count != Some(colours.len()) || count != Some(coverage.len()) {
            return Err(Error::new(ErrorKind::Input, "a masked picture is not whole")
                .found(format!("{} colours, {} coverages", colours.len(), coverage.len()))
                .wanted(format!("{width} · {height} of both, and not none")));
        }
        let inside = |x: &f32| (0.0..=1.0).contains(x);
        if !(colours.iter().flatten().all(inside) && coverage.iter().all(inside)) {
            return Err(Error::new(ErrorKind::Input, "a colour or a coverage is no share")
                .found("a number below 0 or above 1, or none")
                .wanted("0 to 1"));
        }
        Ok(Self { width, height, colours, coverage })
    }

    /// The silhouette in the middle of a square of the network's size, averaged over each of its pixels.
    pub(super) fn framed(&self) -> Result<Framed> {
        let [mut low, mut high] = [[usize::MAX; 2], [0; 2]];
        for (at, _) in self.coverage.iter().enumerate().filter(|(_, covered)| **covered >= INSIDE) {
            for (axis, place) in [at % self.width, at / self.width].into_iter().enumerate() {
                low[axis] = low[axis].min(place);
                high[axis] = high[axis].max(place + 1);
            }
        }
        let empty = |count: usize| {
            Error::new(ErrorKind::Input, "the silhouette is too small for depths")
                .found(format!("{count} of {PIXELS} pixels around it"))
                .wanted(format!("at least {FEWEST}"))
                .fix("give a silhouette that covers more of its surroundings")
        };
        if low[0] == usize::MAX {
            return Err(empty(0));
        }
        let longest = (0..2).map(|axis| high[axis] - low[axis]).max().unwrap_or(1) as f64;
        let pixel = longest / (FILLED * SIZE as f64);
        let corner = [0, 1].map(|axis| 0.5 * ((low[axis] + high[axis]) as f64 - pixel * SIZE as f64));
        let window = Window { corner, pixel };
        let samples = pixel.ceil().clamp(1.0, FINEST) as usize;
        let mut framed = Framed { colours: [0; 3].map(|_| vec![0.0; PIXELS]), silhouette: vec![false; PIXELS], window };
        for at in 0..PIXELS {
            let (mut colour, mut covered, mut weight) = ([0.0f32; 3], 0.0f32, 1e-6f32);
            for sample in 0..samples * samples {
                let share = |cell: usize, part: usize| cell as f64 + (part as f64 + 0.5) / samples as f64;
                let place = [share(at % SIZE, sample % samples), share(at / SIZE, sample / samples)];
                let [x, y] = [0, 1].map(|axis| corner[axis] + pixel * place[axis]);
                if x < 0.0 || y < 0.0 || x >= self.width as f64 || y >= self.height as f64 {
                    continue;
                }
                let index = y as usize * self.width + x as usize;
                covered += self.coverage[index];
                weight += self.coverage[index];
                (0..3).for_each(|k| colour[k] += self.coverage[index] * self.colours[index][k]);
            }
            if covered >= INSIDE * (samples * samples) as f32 {
                framed.silhouette[at] = true;
                (0..3).for_each(|k| framed.colours[k][at] = colour[k] / weight);
            }
        }
        match framed.silhouette.iter().filter(|inside| **inside).count() {
            count if count >= FEWEST => Ok(framed),
            count => Err(empty(count)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rectangle of two colours in a larger picture: it fills the window as it should, and colours stay where they are.
    #[test]
    fn a_silhouette_is_framed() {
        let (width, height) = (300, 200);
        let inside = |x: usize, y: usize| (120..216).contains(&x) && (30..90).contains(&y);
        let pixels = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let colours = pixels().map(|(x, _)| if x < 168 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] }).collect();
        let coverage = pixels().map(|(x, y)| f32::from(u8::from(inside(x, y)))).collect();
        let framed = MaskedPicture::new(width, height, colours, coverage).unwrap().framed().unwrap();
        assert_eq!(framed.window.pixel, 2.0);
        assert_eq!(framed.window.corner, [168.0 - 64.0, 60.0 - 64.0]);
        let count = framed.silhouette.iter().filter(|inside| **inside).count();
        assert_eq!(count, 48 * 30);
        for (column, wanted) in [(20, [1.0, 0.0]), (40, [0.0, 1.0])] {
            let found = [0, 2].map(|k| framed.colours[k][32 * SIZE + column]);
            assert!((0..2).all(|k| (found[k] - wanted[k]).abs() < 1e-5), "{found:?}");
        }
        assert_eq!(framed.window.pixel_at(168.0, 60.0), Some(32 * SIZE + 32));
        assert_eq!(framed.window.pixel_at(10.0, 60.0), None);
    }

    #[test]
    fn a_small_silhouette_is_enlarged_and_an_empty_one_refused() {
        let coverage = (0..400).map(|at| f32::from(u8::from(at % 20 > 5 && at / 20 > 3))).collect();
        let framed = MaskedPicture::new(20, 20, vec![[0.5; 3]; 400], coverage).unwrap().framed().unwrap();
        assert!(framed.window.pixel < 1.0);
        let error = MaskedPicture::new(20, 20, vec![[0.5; 3]; 400], vec![0.0; 400]).unwrap().framed().err().unwrap();
        assert!(error.kind() == ErrorKind::Input && error.to_string().contains("silhouette"), "{error}");
        // a line of pixels
        let line = (0..400).map(|at| f32::from(u8::from(at / 20 == 7))).collect();
        assert!(MaskedPicture::new(20, 20, vec![[0.5; 3]; 400], line).unwrap().framed().is_err());
    }

    #[test]
    fn what_is_no_picture_is_refused() {
        assert!(MaskedPicture::new(2, 2, vec![[0.5; 3]; 4], vec![1.0; 3]).is_err());
        assert!(MaskedPicture::new(0, 2, vec![], vec![]).is_err());
        assert!(MaskedPicture::new(1, 1, vec![[f32::NAN; 3]], vec![1.0]).is_err());
        assert!(MaskedPicture::new(1, 1, vec![[0.5; 3]], vec![1.5]).is_err());
    }
}
