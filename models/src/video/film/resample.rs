//! Resampling of pictures: bilinear, with averaging when shrinking.

/// The input samples of one output sample: index of the first, and the weights.
type Taps = (usize, Vec<f32>);

/// Triangle filter weights from `from` to `to` samples with aligned borders. The filter's half width is one sample,
/// or the distance of two output samples if that is larger.
fn taps(from: usize, to: usize) -> Vec<Taps> {
    let scale = from as f64 / to as f64;
    let reach = scale.max(1.0);
    let one = |i: usize| {
        let middle = (i as f64 + 0.5) * scale - 0.5;
        let first = (middle - reach).ceil().max(0.0) as usize;
        let last = ((middle + reach).floor() as usize).min(from - 1);
        let shares: Vec<f64> = (first..=last).map(|k| 1.0 - (k as f64 - middle).abs() / reach).collect();
        let total: f64 = shares.iter().sum();
        (first, shares.iter().map(|share| (share / total) as f32).collect())
    };
    (0..to).map(one).collect()
}

/// Values of one channel, row by row, resampled from `[width, height]` `from` to `to`.
pub(super) fn resized(values: &[f32], from: [usize; 2], to: [usize; 2]) -> Vec<f32> {
    if from == to {
        return values.to_vec();
    }
    let (across, down) = (taps(from[0], to[0]), taps(from[1], to[1]));
    let of = |row: &[f32], (first, shares): &Taps| -> f32 {
        row[*first..].iter().zip(shares).map(|(value, share)| value * share).sum()
    };
    let narrow: Vec<f32> =
        values.chunks_exact(from[0]).flat_map(|row| across.iter().map(move |taps| of(row, taps))).collect();
    let mut resized = vec![0.0; to[0] * to[1]];
    for (row, (first, shares)) in resized.chunks_exact_mut(to[0]).zip(&down) {
        for (k, share) in shares.iter().enumerate() {
            let from = &narrow[(first + k) * to[0]..][..to[0]];
            row.iter_mut().zip(from).for_each(|(sum, value)| *sum += share * value);
        }
    }
    resized
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane keeps its slope away from the border when enlarged and when whole pixels are merged; a constant
    /// stays constant.
    #[test]
    fn slopes_and_values_stay() {
        let from = [24, 12];
        let plane: Vec<f32> = (0..24 * 12).map(|i| 2.0 * (i % 24) as f32 - 3.0 * (i / 24) as f32).collect();
        for to in [[24, 12], [60, 12], [24, 31], [60, 31], [8, 4]] {
            let found = resized(&plane, from, to);
            let scale = [0, 1].map(|axis| from[axis] as f32 / to[axis] as f32);
            for (i, value) in found.iter().enumerate() {
                let at = [i % to[0], i / to[0]];
                let place = [0, 1].map(|axis| (at[axis] as f32 + 0.5) * scale[axis] - 0.5);
                let reach = scale.map(|s| s.max(1.0));
                if (0..2).all(|axis| place[axis] >= reach[axis] && place[axis] + reach[axis] <= (from[axis] - 1) as f32)
                {
                    let wanted = 2.0 * place[0] - 3.0 * place[1];
                    assert!((value - wanted).abs() < 1e-3, "{to:?} at {at:?}: {value}, not {wanted}");
                }
            }
        }
        assert!(resized(&[0.25; 24 * 12], from, [7, 50]).iter().all(|v| (v - 0.25).abs() < 1e-6));
    }
}
