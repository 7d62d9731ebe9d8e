//! Parts of an object whose hue equals the background's after quantisation to a small palette.
//!
//! Such a part resembles a shadow: darker or brighter than the background, in the same hue. But it is connected
//! with the object and has a sharp edge, unlike the shadow of an airborne object under an extended light. A contact
//! shadow has a sharp edge, too, and cannot be distinguished.

use super::Mask;
use super::change::Change;
use super::silhouette::fill_holes;

/// Minimum change of brightness for a pixel to belong to such a part.
const CHANGED: f32 = 0.1;
/// Maximum step of brightness between neighbours within a part.
const SMOOTH: f32 = 0.06;
/// Minimum share of a part's contour that must be sharp, apart from where it touches the object.
const SHARP: f64 = 0.75;
/// Minimum share of the whole contour that must touch the object.
const TOUCHING: f64 = 0.2;

/// Adds such parts to the mask.
pub(super) fn add(mask: &mut Mask, change: &Change) {
    let smallest = (mask.inside.len() / 8500).max(4);
    let level = CHANGED.max(6.0 * change.noise);
    let step = |a: usize, b: usize| (change.brightness[a] - change.brightness[b]).abs();
    let open: Vec<bool> =
        mask.inside.iter().zip(&change.brightness).map(|(inside, b)| !inside && b.abs() > level).collect();
    // index of the part that a pixel belongs to, from 1
    let mut part = vec![0usize; open.len()];
    let mut found = Vec::new();
    for start in 0..open.len() {
        if part[start] > 0 || !open[start] {
            continue;
        }
        let number = start + 1;
        part[start] = number;
        let (mut pixels, mut next) = (vec![start], 0);
        while let Some(&pixel) = pixels.get(next) {
            next += 1;
            for neighbour in mask.neighbours(pixel) {
                if part[neighbour] == 0 && open[neighbour] && step(pixel, neighbour) < SMOOTH {
                    part[neighbour] = number;
                    pixels.push(neighbour);
                }
            }
        }
        let (mut touching, mut sharp, mut soft) = (0, 0, 0);
        for &pixel in &pixels {
            for neighbour in mask.neighbours(pixel).filter(|n| part[*n] != number) {
                // edges are blurred over a pixel or two
                let beyond = (2 * neighbour).checked_sub(pixel).filter(|b| *b < open.len()).unwrap_or(neighbour);
                match step(pixel, neighbour).max(step(pixel, beyond)) >= level {
                    _ if mask.inside[neighbour] || mask.inside[beyond] => touching += 1,
                    true => sharp += 1,
                    false => soft += 1,
                }
            }
        }
        let of_one_piece = f64::from(touching) >= TOUCHING * f64::from(touching + sharp + soft);
        if pixels.len() >= smallest && of_one_piece && f64::from(sharp) >= SHARP * f64::from(sharp + soft) {
            found.push(pixels);
        }
    }
    found.into_iter().flatten().for_each(|pixel| mask.inside[pixel] = true);
    fill_holes(mask, smallest);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square, half red and half of the floor's hue, above a shadow that darkens towards its middle.
    #[test]
    fn what_has_a_sharp_silhouette_is_of_the_object() {
        let side = 60;
        let red = |x: usize, y: usize| (10..20).contains(&x) && (10..30).contains(&y);
        let grey = |x: usize, y: usize| (20..30).contains(&x) && (10..30).contains(&y);
        let seen = |i: usize| match (i % side, i / side) {
            (x, y) if red(x, y) => [0.5, 0.05, 0.05],
            (x, y) if grey(x, y) => [0.24, 0.22, 0.18],
            (x, y) => {
                let depth = [x as f32 - 20.0, y as f32 - 42.0].map(|d| (-d * d / 60.0).exp());
                [0.4, 0.37, 0.3].map(|v: f32| v * (1.0 - 0.5 * depth[0] * depth[1]))
            }
        };
        let seen: Vec<[f32; 3]> = (0..side * side).map(seen).collect();
        let change = Change::between(&seen, &vec![[0.4, 0.37, 0.3]; side * side], None);
        let inside = (0..side * side).map(|i| red(i % side, i / side)).collect();
        let mut mask = Mask { width: side, height: side, inside };
        add(&mut mask, &change);
        for (i, inside) in mask.inside.iter().enumerate() {
            let (x, y) = (i % side, i / side);
            assert_eq!(*inside, red(x, y) || grey(x, y), "column {x} of row {y}");
        }
    }
}
