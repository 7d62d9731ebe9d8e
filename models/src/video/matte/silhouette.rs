//! From belief to a clean silhouette: the level with the sharpest contour, with specks and pinholes removed.

use super::Mask;

/// Pieces below this share of the largest piece are dropped.
const SMALLEST_PIECE: f32 = 0.1;

/// Thresholds the belief into object and background.
pub(super) fn cut(belief: &[f32], width: usize, height: usize) -> Mask {
    let smallest = (belief.len() / 8500).max(4);
    let mut best = (f32::NEG_INFINITY, 0.5);
    for step in 0..12 {
        let level = 0.3 + 0.05 * step as f32;
        if let Some(sharpness) = sharpness(belief, width, height, level) {
            // Of equally sharp contours prefer the middle level.
            let score = sharpness - 0.05 * (level - 0.5).abs();
            if score > best.0 {
                best = (score, level);
            }
        }
    }
    let mut mask = Mask { width, height, inside: belief.iter().map(|&z| z > best.1).collect() };
    drop_specks(&mut mask, smallest);
    fill_holes(&mut mask, smallest);
    mask
}

/// Mean jump of the belief, over two pixels, along the contour of a level; `None` if the contour is negligible.
fn sharpness(belief: &[f32], width: usize, height: usize, level: f32) -> Option<f32> {
    let (mut sum, mut count) = (0.0f64, 0usize);
    for y in 1..height.saturating_sub(1) {
        for x in 1..width.saturating_sub(1) {
            let i = y * width + x;
            let around = [belief[i - 1], belief[i + 1], belief[i - width], belief[i + width]];
            if belief[i] > level && around.iter().any(|&z| z <= level) {
                let jump = (around[1] - around[0]).abs().max((around[3] - around[2]).abs());
                sum += f64::from(jump);
                count += 1;
            }
        }
    }
    (count >= 8).then(|| (sum / count as f64) as f32)
}

/// Removes pieces smaller than `smallest` pixels or than a tenth of the largest piece.
fn drop_specks(mask: &mut Mask, smallest: usize) {
    let pieces = pieces(mask, true);
    let largest = pieces.iter().map(Vec::len).max().unwrap_or(0);
    let least = smallest.max((SMALLEST_PIECE * largest as f32) as usize);
    for piece in pieces.into_iter().filter(|piece| piece.len() < least) {
        for pixel in piece {
            mask.inside[pixel] = false;
        }
    }
}

/// Fills enclosed holes of at most `largest` pixels and returns the filled pixels; larger holes are real (a torus).
pub(super) fn fill_holes(mask: &mut Mask, largest: usize) -> Vec<usize> {
    let (width, height) = (mask.width, mask.height);
    let border = |pixel: &usize| {
        let (x, y) = (pixel % width, pixel / width);
        x == 0 || y == 0 || x + 1 == width || y + 1 == height
    };
    let holes = pieces(mask, false).into_iter().filter(|piece| piece.len() <= largest && !piece.iter().any(border));
    let filled: Vec<usize> = holes.flatten().collect();
    for &pixel in &filled {
        mask.inside[pixel] = true;
    }
    filled
}

/// The 4-connected pieces of the pixels whose value is `inside`.
pub(super) fn pieces(mask: &Mask, inside: bool) -> Vec<Vec<usize>> {
    let mut seen = vec![false; mask.inside.len()];
    let mut pieces = Vec::new();
    for start in 0..seen.len() {
        if seen[start] || mask.inside[start] != inside {
            continue;
        }
        seen[start] = true;
        let mut piece = vec![start];
        let mut next = 0;
        while let Some(&pixel) = piece.get(next) {
            next += 1;
            for neighbour in mask.neighbours(pixel) {
                if !seen[neighbour] && mask.inside[neighbour] == inside {
                    seen[neighbour] = true;
                    piece.push(neighbour);
                }
            }
        }
        pieces.push(piece);
    }
    pieces
}
