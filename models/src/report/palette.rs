//! Colour quantisation to a palette of 256 colours for a set of pictures.
//!
//! Colours are counted in a histogram of 32³ cells; the box of cells with the largest variance is split at its mean
//! until the palette is full. Colours are weighted by the square root of their frequency, so that a large
//! background does not use up the palette. Pictures with few colours keep them exactly. Based on X. Wu, *Efficient
//! statistical computations for optimal color quantization*, 1991.

use std::collections::{BTreeSet, HashMap};

/// Size of a palette.
const PLACES: usize = 256;

/// Variance below which a group is one colour; far above rounding, so that a split always yields two nonempty
/// groups.
const NO_SPREAD: f64 = 1e-6;

/// The colours, with a cache of the nearest one for every requested colour.
pub(super) struct Palette {
    colours: Vec<[u8; 3]>,
    nearest: HashMap<[u8; 3], u8>,
}

/// The colours of one histogram cell: weight and mean.
struct Cell {
    weight: f64,
    mean: [f64; 3],
}

/// Some cells, with their axis of largest variance and that variance.
struct Group {
    cells: Vec<Cell>,
    mean: [f64; 3],
    axis: usize,
    spread: f64,
}

impl Palette {
    /// The palette of these pixels.
    pub(super) fn of<'a>(pixels: impl Iterator<Item = &'a [u8; 3]> + Clone) -> Self {
        let mut exact = BTreeSet::new();
        for pixel in pixels.clone() {
            exact.insert(*pixel);
            if exact.len() > PLACES {
                return Self { colours: cut(histogram(pixels)), nearest: HashMap::new() };
            }
        }
        Self { colours: exact.into_iter().collect(), nearest: HashMap::new() }
    }

    /// The colours as consecutive bytes, three each.
    pub(super) fn bytes(&self) -> Vec<u8> {
        self.colours.concat()
    }

    /// Index of the nearest colour by squared distance.
    pub(super) fn index(&mut self, colour: [u8; 3]) -> u8 {
        let colours = &self.colours;
        *self.nearest.entry(colour).or_insert_with(|| {
            let distance = |other: &[u8; 3]| -> i32 {
                colour.iter().zip(other).map(|(&a, &b)| (i32::from(a) - i32::from(b)).pow(2)).sum()
            };
            let best = (0..colours.len()).min_by_key(|&i| distance(&colours[i]));
            best.expect("a palette has a colour") as u8
        })
    }
}

fn histogram<'a>(pixels: impl Iterator<Item = &'a [u8; 3]>) -> Vec<Cell> {
    let mut sums = vec![[0u64; 4]; 1 << 15];
    for &[r, g, b] in pixels {
        let cell = &mut sums[usize::from(r >> 3) << 10 | usize::from(g >> 3) << 5 | usize::from(b >> 3)];
        for (sum, value) in cell.iter_mut().zip([r, g, b, 1]) {
            *sum += u64::from(value);
        }
    }
    let filled = sums.into_iter().filter(|&[.., count]| count > 0);
    filled
        .map(|[r, g, b, count]| Cell {
            weight: (count as f64).sqrt(),
            mean: [r, g, b].map(|sum| sum as f64 / count as f64),
        })
        .collect()
}

fn cut(cells: Vec<Cell>) -> Vec<[u8; 3]> {
    let mut groups = vec![Group::of(cells)];
    while groups.len() < PLACES {
        let widest = (0..groups.len()).max_by(|&a, &b| groups[a].spread.total_cmp(&groups[b].spread));
        let widest = widest.expect("there is always a group");
        if groups[widest].spread <= NO_SPREAD {
            break;
        }
        let Group { cells, mean, axis, .. } = groups.swap_remove(widest);
        let (low, high): (Vec<_>, Vec<_>) = cells.into_iter().partition(|cell| cell.mean[axis] < mean[axis]);
        groups.extend([low, high].into_iter().filter(|half| !half.is_empty()).map(Group::of));
    }
    groups.iter().map(|group| group.mean.map(|value| value.round() as u8)).collect()
}

impl Group {
    fn of(cells: Vec<Cell>) -> Self {
        let weight: f64 = cells.iter().map(|cell| cell.weight).sum();
        let mean = [0, 1, 2].map(|i| cells.iter().map(|cell| cell.weight * cell.mean[i]).sum::<f64>() / weight);
        let spread =
            [0, 1, 2].map(|i| cells.iter().map(|cell| cell.weight * (cell.mean[i] - mean[i]).powi(2)).sum::<f64>());
        let axis = (0..3).max_by(|&a, &b| spread[a].total_cmp(&spread[b])).expect("three axes");
        // a single cell cannot be split, even if rounding gives it a variance
        let spread = if cells.len() > 1 { spread[axis] } else { 0.0 };
        Self { cells, mean, axis, spread }
    }
}
