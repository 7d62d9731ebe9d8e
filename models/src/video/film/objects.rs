//! Several objects in a film: pieces of the mattes are tracked from frame to frame, and all but one object are
//! removed.

use gradreel::{Error, ErrorKind, Result};

use crate::video::clip::Flight;
use crate::video::matte::{self, Matte};

/// Pieces below this share of the largest piece in their frame are not tracked.
const NOTABLE: f64 = 0.1;

/// Minimum area of a second object, as a share of the largest one's, and minimum number of frames with that area.
const COMPARABLE: (f64, usize) = (0.2, 3);

/// Pieces of the first frame closer than this share of their sides belong to one object.
const ONE: f64 = 0.1;

/// A new piece closer to an object than this share of the object's side is a fragment of it.
const COME_OFF: f64 = 1.0;

/// Growth of a piece's area, as a factor, that indicates that two objects meet.
const MEETING: f64 = 1.3;

/// Width of the blurred edge around another object \[pixels\].
const EDGE: usize = 3;

/// Result of removing the other objects.
pub(super) struct Alone {
    /// Number of frames until the objects meet or the object is gone.
    pub frames: usize,
    pub said: String,
}

/// A connected piece of a matte.
struct Piece {
    pixels: Vec<usize>,
    /// Left, top, right and bottom \[pixels\].
    rect: [f64; 4],
    middle: [f64; 2],
    /// Index of its object.
    object: usize,
    /// Displacement since the previous frame.
    moved: [f64; 2],
}

impl Piece {
    fn of(pixels: Vec<usize>, width: usize) -> Self {
        let (mut rect, mut sum) = ([f64::INFINITY, f64::INFINITY, 0.0, 0.0], [0.0; 2]);
        for pixel in &pixels {
            let [x, y] = [(pixel % width) as f64, (pixel / width) as f64];
            rect = [rect[0].min(x), rect[1].min(y), f64::max(rect[2], x + 1.0), f64::max(rect[3], y + 1.0)];
            sum = [sum[0] + x + 0.5, sum[1] + y + 0.5];
        }
        let middle = sum.map(|sum| sum / pixels.len() as f64);
        Self { pixels, rect, middle, object: 0, moved: [0.0; 2] }
    }

    fn area(&self) -> f64 {
        self.pixels.len() as f64
    }

    fn side(&self) -> f64 {
        self.area().sqrt()
    }

    /// Gap between the bounding rectangles of two pieces.
    fn gap(&self, other: &Self) -> f64 {
        let along = |axis: usize| {
            (self.rect[axis].max(other.rect[axis]) - self.rect[axis + 2].min(other.rect[axis + 2])).max(0.0)
        };
        along(0).hypot(along(1))
    }

    /// Distance of a piece from this one's predicted position in the next frame.
    fn expects(&self, other: &Self) -> f64 {
        let off = |axis: usize| self.middle[axis] + self.moved[axis] - other.middle[axis];
        off(0).hypot(off(1))
    }
}

/// Keeps one object in the mattes of a film that shows several separate objects of comparable size for some frames:
/// the largest in the first frame. `None` if there is only one.
///
/// # Errors
/// [`ErrorKind::Input`] if it meets another object before its ballistic phase is seen.
pub(super) fn alone(mattes: &mut [Matte], width: usize, height: usize, place: &str) -> Result<Option<Alone>> {
    let mut frames: Vec<Vec<Piece>> = mattes.iter().map(|(_, alpha)| pieces(alpha, width, height)).collect();
    if frames.iter().filter(|pieces| pieces.len() > 1).count() < COMPARABLE.1 {
        return Ok(None);
    }
    let count = follow(&mut frames);
    let areas = |object: usize| -> Vec<f64> {
        let of = |pieces: &Vec<Piece>| pieces.iter().filter(|p| p.object == object).map(Piece::area).sum();
        frames.iter().map(of).collect()
    };
    let areas: Vec<Vec<f64>> = (0..count).map(areas).collect();
    let Some(start) = frames.iter().position(|pieces| !pieces.is_empty()) else { return Ok(None) };
    let first = |object: &usize| areas[*object][start];
    let kept = (0..count).max_by(|a, b| first(a).total_cmp(&first(b))).unwrap_or(0);
    let comparable = |object: &usize| {
        let each = areas[*object].iter().zip(&areas[kept]);
        *object != kept
            && each.filter(|(own, kept)| **own > 0.0 && **own >= COMPARABLE.0 * **kept).count() >= COMPARABLE.1
    };
    let others: Vec<usize> = (0..count).filter(comparable).collect();
    if others.is_empty() {
        return Ok(None);
    }
    let ends = |k: &usize| {
        let (before, now) = (areas[kept][k - 1], areas[kept][*k]);
        let gone = others.iter().any(|other| areas[*other][k - 1] > 0.0 && areas[*other][*k] == 0.0);
        !frames[*k].is_empty() && (now == 0.0 || (gone && before > 0.0 && now > MEETING * before))
    };
    let end = (start + 1..frames.len()).find(ends).unwrap_or(frames.len());
    if end < Flight::LEAST_FRAMES {
        return Err(Error::new(ErrorKind::Input, "several objects move, and they meet at once")
            .at(place)
            .found(format!("{} objects, apart in the first {end} frames only", others.len() + 1))
            .wanted(format!("one object, or one that is seen alone in the first {} frames", Flight::LEAST_FRAMES))
            .fix("choose the frames that show one (--first-frame, --frames), or give masks of it (--masks FOLDER)"));
    }
    for (k, (rgb, alpha)) in mattes.iter_mut().enumerate().take(end) {
        let out = others_in(&frames[k], &others, alpha, [width, height]);
        leave_out(rgb, alpha, &out, [width, height]);
    }
    let until = if end < frames.len() { format!(", until frame {end}, where they meet") } else { String::new() };
    let sizes: Vec<String> = others.iter().map(|object| most(&areas[*object]).to_string()).collect();
    let said = format!(
        "several objects are seen: the largest of the first frame is taken ({} pixels there, others up to {}){until}; give masks (--masks) \
         for another one",
        areas[kept][start],
        sizes.join(", ")
    );
    Ok(Some(Alone { frames: end, said }))
}

fn most(areas: &[f64]) -> f64 {
    areas.iter().copied().fold(0.0, f64::max)
}

/// The pieces of a matte that are large enough to track.
fn pieces(alpha: &[f32], width: usize, height: usize) -> Vec<Piece> {
    let pieces = matte::pieces(alpha, width, height);
    let largest = pieces.iter().map(Vec::len).max().unwrap_or(0) as f64;
    let notable = pieces.into_iter().filter(|piece| piece.len() as f64 >= NOTABLE * largest);
    notable.map(|pixels| Piece::of(pixels, width)).collect()
}

/// Assigns each piece to an object, given the pieces of the previous frame; returns the number of objects.
fn follow(frames: &mut [Vec<Piece>]) -> usize {
    let mut count = 0;
    let mut last: Option<usize> = None;
    for k in 0..frames.len() {
        let (before, now) = frames.split_at_mut(k);
        let now = &mut now[0];
        if now.is_empty() {
            continue;
        }
        match last {
            None => count = apart(now),
            Some(last) => count = continued(&before[last], now, count),
        }
        last = Some(k);
    }
    count
}

/// The objects of the first frame that shows any.
fn apart(pieces: &mut [Piece]) -> usize {
    let mut count = 0;
    for i in 0..pieces.len() {
        let near = |j: &usize| pieces[i].gap(&pieces[*j]) <= ONE * pieces[i].side().max(pieces[*j].side());
        pieces[i].object = match (0..i).find(near) {
            Some(j) => pieces[j].object,
            None => {
                count += 1;
                count - 1
            }
        };
    }
    count
}

/// The objects of the next frame: each piece of the previous frame continues as the piece nearest to its predicted
/// position. A remaining piece is a fragment of a nearby object, or a new object.
fn continued(before: &[Piece], now: &mut [Piece], mut count: usize) -> usize {
    let mut pairs: Vec<(f64, usize, usize)> = before
        .iter()
        .enumerate()
        .flat_map(|(i, old)| now.iter().enumerate().map(move |(j, new)| (old.expects(new), i, j)))
        .collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut taken, mut found) = (vec![false; before.len()], vec![false; now.len()]);
    for (_, i, j) in pairs {
        if !taken[i] && !found[j] {
            (taken[i], found[j]) = (true, true);
            now[j].object = before[i].object;
            now[j].moved = [0, 1].map(|axis| now[j].middle[axis] - before[i].middle[axis]);
        }
    }
    for j in (0..now.len()).filter(|j| !found[*j]) {
        let nearest = before.iter().min_by(|a, b| a.gap(&now[j]).total_cmp(&b.gap(&now[j])));
        now[j].object = match nearest.filter(|old| old.gap(&now[j]) <= COME_OFF * old.side()) {
            Some(old) => old.object,
            None => {
                count += 1;
                count - 1
            }
        };
    }
    count
}

/// Mask of the pixels of other objects: their pieces, and small pieces that are nearest to them.
fn others_in(pieces: &[Piece], others: &[usize], alpha: &[f32], [width, height]: [usize; 2]) -> Vec<bool> {
    let mut out = vec![false; alpha.len()];
    for small in matte::pieces(alpha, width, height) {
        let piece = Piece::of(small, width);
        let nearest = pieces.iter().min_by(|a, b| a.gap(&piece).total_cmp(&b.gap(&piece)));
        let own = pieces.iter().find(|known| known.pixels.first() == piece.pixels.first()).or(nearest);
        if own.is_some_and(|own| others.contains(&own.object)) {
            piece.pixels.iter().for_each(|pixel| out[*pixel] = true);
        }
    }
    out
}

/// Removes from a matte what was removed from another matte of the same picture, whose mask was `all` and is now
/// `left`: whole pieces that overlap only the removed region, and the removed pixels of other pieces.
pub(super) fn leave_out_of((rgb, alpha): &mut Matte, left: &[f32], all: &[bool], size: [usize; 2]) {
    let is_left = |pixel: usize| left[pixel] > 0.5;
    let mut out: Vec<bool> = (0..all.len()).map(|pixel| all[pixel] && !is_left(pixel)).collect();
    for piece in matte::pieces(alpha, size[0], size[1]) {
        if piece.iter().any(|pixel| out[*pixel]) && !piece.iter().any(|pixel| is_left(*pixel)) {
            piece.into_iter().for_each(|pixel| out[pixel] = true);
        }
    }
    leave_out(rgb, alpha, &out, size);
}

/// Clears pixels and the edge around them to white and transparent.
fn leave_out(rgb: &mut [[f32; 3]], alpha: &mut [f32], out: &[bool], [width, height]: [usize; 2]) {
    let solid: Vec<bool> = alpha.iter().zip(out).map(|(alpha, out)| *alpha > 0.5 && !out).collect();
    let keep = matte::grown(&solid, width, height, 1);
    let around = matte::grown(out, width, height, EDGE);
    for i in (0..alpha.len()).filter(|&i| around[i] && !keep[i]) {
        (rgb[i], alpha[i]) = ([1.0; 3], 0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [120, 90];

    /// Squares given by side, column and row.
    fn matte(squares: &[(usize, usize, usize)]) -> Matte {
        let inside = |i: usize| {
            let (x, y) = (i % SIZE[0], i / SIZE[0]);
            squares.iter().any(|(side, left, top)| (*left..left + side).contains(&x) && (*top..top + side).contains(&y))
        };
        let alpha: Vec<f32> = (0..SIZE[0] * SIZE[1]).map(|i| f32::from(u8::from(inside(i)))).collect();
        (alpha.iter().map(|a| [1.0 - 0.5 * a; 3]).collect(), alpha)
    }

    fn area((_, alpha): &Matte) -> usize {
        alpha.iter().filter(|alpha| **alpha > 0.5).count()
    }

    #[test]
    fn the_larger_of_two_is_left_until_they_meet() {
        // a square falls on the left, a smaller one rises on the right; later they touch
        let scene = |k: usize| matte(&[(16, 10 + 6 * k, 5 + 6 * k), (10, 90, 70 - 5 * k)]);
        let mut mattes: Vec<Matte> = (0..8).map(scene).collect();
        let alone = alone(&mut mattes, SIZE[0], SIZE[1], "film").unwrap().unwrap();
        assert_eq!(alone.frames, 8);
        assert!(alone.said.contains("several objects") && alone.said.contains("256 pixels"), "{}", alone.said);
        for (k, found) in mattes.iter().enumerate() {
            assert_eq!(*found, matte(&[(16, 10 + 6 * k, 5 + 6 * k)]), "frame {k}");
        }
        let meeting = |k: usize| matte(&[(16, 10, 5 + 6 * k), (12, 10, 80 - 6 * k)]);
        let mut mattes: Vec<Matte> = (0..8).map(meeting).collect();
        let found = super::alone(&mut mattes, SIZE[0], SIZE[1], "film").unwrap().unwrap();
        // 16 + 5 + 6 k reaches 80 − 6 k at k = 5
        assert!(found.frames == 5 && found.said.contains("until frame 5"), "{}: {}", found.frames, found.said);
    }

    #[test]
    fn what_comes_off_an_object_is_of_it() {
        let scene = |k: usize| match k {
            0..4 => matte(&[(20, 50, 10 + 10 * k)]),
            _ => matte(&[(12, 50, 50), (9, 50 - 3 * k, 60), (9, 60 + 3 * k, 60)]),
        };
        let mut mattes: Vec<Matte> = (0..10).map(scene).collect();
        let before: Vec<usize> = mattes.iter().map(area).collect();
        assert!(alone(&mut mattes, SIZE[0], SIZE[1], "film").unwrap().is_none());
        assert_eq!(mattes.iter().map(area).collect::<Vec<_>>(), before);
    }

    #[test]
    fn one_that_comes_later_is_another() {
        let scene = |k: usize| match k {
            0..3 => matte(&[(16, 10, 5 + 8 * k)]),
            _ => matte(&[(16, 10, 5 + 8 * k), (16, 130 - 8 * k, 60)]),
        };
        let mut mattes: Vec<Matte> = (0..8).map(scene).collect();
        let found = alone(&mut mattes, SIZE[0], SIZE[1], "film").unwrap().unwrap();
        assert_eq!(found.frames, 8);
        assert!(mattes.iter().all(|matte| area(matte) == 256));
    }
}
