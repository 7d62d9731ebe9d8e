//! Lookups of grids, compositing along rays, and sums of rows.

use gradreel::ops::{GridSampling, segment_offsets};
use gradreel::{Key, Tape, Tensor};

use crate::harness::{Case, numbers};

pub fn cases() -> Vec<Case> {
    vec![
        lookup("grid_sample_3d 64ch 32^3 -> 48x32x32", &[1, 64, 32, 32, 32], &[1, 48, 32, 32, 3]),
        lookup("grid_sample_2d 64ch 128^2 -> 256x256", &[1, 64, 128, 128], &[1, 256, 256, 2]),
        lookup("grid_sample_3d 1ch 128^3 -> 2^20 points", &[1, 1, 128, 128, 128], &[1, 1 << 20, 1, 1, 3]),
        composite(),
        index_add(),
        segment_sum(),
    ]
}

/// Random points: neighbours in the list are not neighbours in the grid.
fn lookup(name: &'static str, grid: &[usize], points: &[usize]) -> Case {
    let (values, at) = (numbers(1, grid), numbers(2, points));
    let rank = points[points.len() - 1];
    let samples = grid[1] * at.len() / rank;
    let run = move |both: bool| {
        let tape = Tape::new();
        let (values, at) = (tape.leaf(values.clone()), tape.leaf(at.clone()));
        let y = values.grid_sample(&at, GridSampling { align_corners: true, ..GridSampling::default() });
        if both {
            y.sum_all().backward().expect("a gradient");
        }
    };
    let bytes = 4 * (grid.iter().product::<usize>() + points.iter().product::<usize>() + samples);
    Case { name, flop: ((2 << rank) * samples) as f64, bytes: bytes as f64, run: Box::new(run) }
}

fn composite() -> Case {
    let (rays, samples) = (8192usize, 128usize);
    let alpha = numbers(1, [rays * samples]);
    let alpha = Tensor::from_vec(alpha.slice::<f32>().iter().map(|a| a.abs() * 0.1).collect(), [rays * samples]);
    let offsets: Vec<u32> = (0..=rays as u32).map(|ray| ray * samples as u32).collect();
    let offsets = Tensor::from_vec(offsets, [rays + 1]);
    let bytes = (8 * rays * samples) as f64;
    let run = move |both: bool| {
        let tape = Tape::new();
        let (alpha, offsets) = (tape.leaf(alpha.clone()), tape.constant(offsets.clone()));
        let weights = alpha.ray_weights(&offsets, None).expect("offsets");
        let left = alpha.ray_transmittance(&offsets, None).expect("offsets");
        let total = &weights.sum_all() + &left.sum_all();
        if both {
            total.backward().expect("a gradient");
        }
    };
    Case { name: "composite 8192 rays x 128", flop: 0.0, bytes, run: Box::new(run) }
}

fn index_add() -> Case {
    let (count, row, rows) = (1usize << 20, 4usize, 1usize << 16);
    let x = numbers(1, [count, row]);
    let index: Vec<u32> = Key::new(3).uniform(count).map(|u| (u * rows as f64) as u32).collect();
    let index = Tensor::from_vec(index, [count]);
    let run = move |both: bool| {
        let tape = Tape::new();
        let (x, index) = (tape.leaf(x.clone()), tape.constant(index.clone()));
        let y = x.index_add(&index, rows).expect("rows");
        if both {
            y.sum_all().backward().expect("a gradient");
        }
    };
    let bytes = (4 * (count * row + count + rows * row)) as f64;
    Case { name: "index_add 2^20 x 4 -> 2^16", flop: 0.0, bytes, run: Box::new(run) }
}

fn segment_sum() -> Case {
    let (count, row, segments) = (1usize << 20, 4usize, 1usize << 14);
    let x = numbers(1, [count, row]);
    let names: Vec<u32> = (0..count as u32).map(|i| i >> 6).collect();
    let offsets = segment_offsets(&names, segments).expect("rising names");
    let offsets = Tensor::from_vec(offsets, [segments + 1]);
    let run = move |both: bool| {
        let tape = Tape::new();
        let (x, offsets) = (tape.leaf(x.clone()), tape.constant(offsets.clone()));
        let y = x.segment_sum(&offsets).expect("offsets");
        if both {
            y.sum_all().backward().expect("a gradient");
        }
    };
    let bytes = (4 * (count * row + segments * row)) as f64;
    Case { name: "segment_sum 2^20 x 4 -> 2^14", flop: 0.0, bytes, run: Box::new(run) }
}
