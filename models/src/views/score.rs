//! Agreement of a generated view with the true one.

use gradreel::{Result, Tensor};

use super::ImageBox;
use super::image_box::not_white;
use super::objects::View;

/// Agreement of one view, or the mean of several.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Score {
    /// Distance between the centres of the object's boxes, as a share of the image's side.
    pub centre: f64,
    /// Intersection over union of these boxes.
    pub overlap: f64,
    /// Peak signal-to-noise ratio of the colours \[dB\]; 100 for identical pictures.
    pub psnr: f64,
    /// Intersection over union of the silhouettes.
    pub silhouette: f64,
}

impl Score {
    /// Compares a generated picture `[3, s, s]` in about −1..1 with a true view of the same size.
    ///
    /// The object in the generated picture is its largest connected non-white region. An empty picture counts as a
    /// single point in the centre.
    ///
    /// # Errors
    /// If the picture cannot be read.
    ///
    /// # Panics
    /// If the sizes differ.
    #[track_caller]
    pub fn of(found: &Tensor, truth: &View) -> Result<Self> {
        let (size, area) = (truth.size, truth.size * truth.size);
        assert_eq!(found.dims(), [3, size, size], "the picture has another size than the view");
        let values: Vec<f64> = found.to_vec()?.into_iter().map(|v| v.clamp(-1.0, 1.0)).collect();
        let object = largest_part(&(0..area).map(|i| not_white(&values, i)).collect::<Vec<bool>>(), size);
        let covered: Vec<bool> = truth.coverage.iter().map(|share| *share >= 0.5).collect();
        let count = |pixel: &dyn Fn(usize) -> bool| (0..area).filter(|i| pixel(*i)).count() as f64;
        let (common, all) = (count(&|i| object[i] && covered[i]), count(&|i| object[i] || covered[i]));
        let share = |inside: &bool| f32::from(u8::from(*inside));
        let boxed = |mask: &[bool]| ImageBox::of_coverage(&mask.iter().map(share).collect::<Vec<f32>>(), size);
        let point = ImageBox { low: [0.5; 2], high: [0.5; 2] };
        let [ours, theirs] = [&object, &covered].map(|mask| boxed(mask).unwrap_or(point));
        let [a, b] = [ours.centre(), theirs.centre()];
        let squares = values.iter().zip(&truth.colours).map(|(a, b)| (0.5 * (a - f64::from(*b))).powi(2));
        let error = squares.sum::<f64>() / (3 * area) as f64;
        Ok(Self {
            centre: (a[0] - b[0]).hypot(a[1] - b[1]),
            overlap: ours.overlap(&theirs),
            psnr: -10.0 * error.max(1e-10).log10(),
            silhouette: if all > 0.0 { common / all } else { 1.0 },
        })
    }

    /// Mean of several scores.
    pub fn mean(scores: &[Self]) -> Self {
        let count = scores.len().max(1) as f64;
        let of = |part: fn(&Self) -> f64| scores.iter().map(part).sum::<f64>() / count;
        Self {
            centre: of(|s| s.centre),
            overlap: of(|s| s.overlap),
            psnr: of(|s| s.psnr),
            silhouette: of(|s| s.silhouette),
        }
    }
}

/// The largest 4-connected region of a mask.
fn largest_part(mask: &[bool], width: usize) -> Vec<bool> {
    let mut part_of = vec![0usize; mask.len()];
    let (mut parts, mut best) = (0, (0, 0));
    for start in 0..mask.len() {
        if !mask[start] || part_of[start] > 0 {
            continue;
        }
        parts += 1;
        part_of[start] = parts;
        let (mut waiting, mut count) = (vec![start], 0);
        while let Some(pixel) = waiting.pop() {
            count += 1;
            let (x, y) = (pixel % width, pixel / width);
            let beside = [
                (x > 0).then(|| pixel - 1),
                (x + 1 < width).then(|| pixel + 1),
                (y > 0).then(|| pixel - width),
                (pixel + width < mask.len()).then(|| pixel + width),
            ];
            for next in beside.into_iter().flatten() {
                if mask[next] && part_of[next] == 0 {
                    part_of[next] = parts;
                    waiting.push(next);
                }
            }
        }
        best = best.max((count, parts));
    }
    part_of.iter().map(|part| *part > 0 && *part == best.1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of one colour on white.
    fn square(low: [usize; 2], side: usize, colour: f32) -> View {
        let size = 16;
        let inside = |i: usize| (0..2).all(|axis| (low[axis]..low[axis] + side).contains(&[i % size, i / size][axis]));
        let coverage: Vec<f32> = (0..size * size).map(|i| f32::from(u8::from(inside(i)))).collect();
        let colours = (0..3 * size * size).map(|i| if inside(i % (size * size)) { colour } else { 1.0 });
        View { size, colours: colours.collect(), coverage }
    }

    #[test]
    fn squares_and_specks() {
        let truth = square([4, 4], 8, -1.0);
        let picture = |view: &View| Tensor::from_vec(view.colours.clone(), [3, 16, 16]);
        let same = Score::of(&picture(&truth), &truth).unwrap();
        assert_eq!((same.centre, same.overlap, same.psnr, same.silhouette), (0.0, 1.0, 100.0, 1.0));
        // three pixels to the right: 5 of 11 columns overlap
        let moved = Score::of(&picture(&square([7, 4], 8, -1.0)), &truth).unwrap();
        assert!((moved.centre - 3.0 / 16.0).abs() < 1e-12);
        assert!((moved.overlap - 5.0 / 11.0).abs() < 1e-12 && (moved.silhouette - 5.0 / 11.0).abs() < 1e-12);
        assert!((moved.psnr + 10.0 * (48.0 / 256.0f64).log10()).abs() < 1e-9);
        // a distant speck is not part of the object
        let mut speck = truth.clone();
        speck.colours[16 * 16 - 1] = -1.0;
        let found = Score::of(&picture(&speck), &truth).unwrap();
        assert_eq!((found.centre, found.overlap, found.silhouette), (0.0, 1.0, 1.0));
        let nothing = Score::of(&Tensor::from_vec(vec![1.0f32; 3 * 256], [3, 16, 16]), &truth).unwrap();
        assert_eq!((nothing.centre, nothing.overlap, nothing.silhouette), (0.0, 0.0, 0.0));
        assert_eq!(Score::mean(&[same, moved]).overlap, 0.5 * (1.0 + 5.0 / 11.0));
    }
}
