//! The shutter of the camera: what moves while a picture is exposed is blurred, and rows that are read one after the other see it at
//! different times.

use gradreel::{DType, Result, Tensor, Var};

use crate::vector::{dot, minus};
use crate::video::{Camera, Clip, Shutter};

/// Instants of an exposure whose mean is a picture.
const INSTANTS: usize = 4;

/// The rows of a film from a single camera.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::identify) struct Rows {
    camera: Camera,
    /// Their number in the film, of which the clip's pictures may be a smaller copy.
    count: f64,
}

impl Rows {
    /// Those of a clip; none if it is not a film.
    pub fn of(clip: &Clip) -> Option<Self> {
        let ([camera], Some(story)) = (&clip.cameras[..], &clip.story) else { return None };
        (story.filmed.1 > 0).then(|| Self { camera: camera.clone(), count: story.filmed.1 as f64 })
    }

    /// The rows that a camera reads, so many in the film.
    #[cfg(test)]
    pub fn new(camera: Camera, count: f64) -> Self {
        Self { camera, count }
    }

    /// Their number in the film.
    pub fn count(&self) -> f64 {
        self.count
    }

    /// Right, up and away in the world.
    fn axis(&self, column: usize, sign: f64) -> [f64; 3] {
        self.camera.c2w.map(|row| sign * row[column])
    }

    /// How many pictures are as high as the tangent of an angle, and where its row is: `v/height − ½ = from + per · up/away`.
    fn scale(&self) -> [f64; 2] {
        let height = self.camera.height as f64;
        [self.camera.cy / height - 0.5, -self.camera.fy / height]
    }
}

/// A shutter at work: offsets of its instants from the times of frames, in intervals between frames.
#[derive(Debug, Clone)]
pub(in crate::identify) struct Instants<'a> {
    /// Those of the exposure.
    offsets: Vec<f64>,
    /// The rows, and the time in which all are read.
    rolling: Option<(&'a Rows, f64)>,
}

impl<'a> Instants<'a> {
    /// Those of a shutter in a film with this time between frames \[s\].
    pub fn of(shutter: Shutter, rows: Option<&'a Rows>, frame_dt: f64) -> Self {
        let exposure = shutter.exposure / frame_dt;
        let offsets = match exposure > 0.0 {
            true => (0..INSTANTS).map(|k| exposure * ((k as f64 + 0.5) / INSTANTS as f64 - 0.5)).collect(),
            false => vec![0.0],
        };
        let rolling = rows.filter(|_| shutter.row_time != 0.0);
        Self { offsets, rolling: rolling.map(|rows| (rows, shutter.row_time * rows.count / frame_dt)) }
    }

    /// Positions at each instant `[particles, 3]` \[m\], from those a frame before, at the frame and a frame after, on their tape:
    /// `x + s (x₊ − x)` after it, and `x − s (x₋ − x)` before it.
    pub fn on_tape(&self, [before, now, after]: [&Var; 3]) -> Result<Vec<Var>> {
        let late = self.rolling.map(|(rows, read)| self.late(now, rows, read)).transpose()?;
        let at = |offset: &f64| match &late {
            Some(late) => {
                let later = late + *offset;
                now + &(&later.relu() * &(after - now)) + &(-&later).relu() * &(before - now)
            }
            None if *offset > 0.0 => now + &((after - now) * *offset),
            None => now + &((before - now) * -*offset),
        };
        Ok(self.offsets.iter().map(at).collect())
    }

    /// How late each particle's row is read, `[particles, 1]`.
    fn late(&self, now: &Var, rows: &Rows, read: f64) -> Result<Var> {
        let tape = now.tape();
        let tensor = |values: &[f64], dims: &[usize]| -> Result<Var> {
            Ok(tape.constant(Tensor::from_vec(values.to_vec(), dims).cast(now.dtype())?))
        };
        let from_camera = now - &tensor(&rows.camera.centre(), &[3])?;
        let along = |axis: [f64; 3]| Ok::<_, gradreel::Error>(from_camera.matmul(&tensor(&axis, &[3, 1])?));
        let tangent = &along(rows.axis(1, 1.0))? / &along(rows.axis(2, -1.0))?;
        let [from, per] = rows.scale();
        // what is outside the picture is seen with its edge
        Ok((tangent * per + from).clamp(-0.5, 0.5) * read)
    }

    /// The same in forward mode: positions at each instant, and their tangents from those a frame before, at the frame and after it.
    ///
    /// # Errors
    /// Never for `f32` and `f64`.
    pub fn jvp(&self, places: &[Tensor; 3], directions: &[[Tensor; 3]]) -> Result<Vec<(Tensor, Vec<Tensor>)>> {
        let dtype = places[0].dtype();
        let values =
            |of: &[Tensor; 3]| -> Result<[Vec<f64>; 3]> { Ok([of[0].to_vec()?, of[1].to_vec()?, of[2].to_vec()?]) };
        let (x, dx) = (values(places)?, directions.iter().map(values).collect::<Result<Vec<_>>>()?);
        let dims = places[1].dims().to_vec();
        let tensor = |values: Vec<f64>| Tensor::from_vec(values, &dims[..]).cast(dtype);
        let each = self.offsets.iter().map(|offset| {
            let late: Vec<[f64; 4]> = x[1].as_chunks::<3>().0.iter().map(|x| self.late_of(*x)).collect();
            let share = |i: usize| offset + late[i / 3][0];
            // before or after the frame
            let side = |i: usize| if share(i) > 0.0 { 2 } else { 0 };
            let moved = |of: &[Vec<f64>; 3], i: usize| of[1][i] + share(i).abs() * (of[side(i)][i] - of[1][i]);
            let positions = tensor((0..x[1].len()).map(|i| moved(&x, i)).collect())?;
            let tangent = |d: &[Vec<f64>; 3]| {
                let one = |i: usize| {
                    let own = 3 * (i / 3);
                    let later =
                        dot(late[i / 3][1..].try_into().expect("three"), std::array::from_fn(|k| d[1][own + k]));
                    let along = if share(i) > 0.0 { x[2][i] - x[1][i] } else { x[1][i] - x[0][i] };
                    moved(d, i) + later * along
                };
                tensor((0..x[1].len()).map(one).collect())
            };
            Ok((positions, dx.iter().map(tangent).collect::<Result<_>>()?))
        });
        each.collect()
    }

    /// How late the row of a point is read, and the gradient of that in its position.
    fn late_of(&self, x: [f64; 3]) -> [f64; 4] {
        let Some((rows, read)) = self.rolling else { return [0.0; 4] };
        let (above, beyond) = (rows.axis(1, 1.0), rows.axis(2, -1.0));
        let from_camera = minus(x, rows.camera.centre());
        let (up, away) = (dot(above, from_camera), dot(beyond, from_camera));
        let [from, per] = rows.scale();
        let row = from + per * up / away;
        if row.abs() > 0.5 {
            return [read * row.clamp(-0.5, 0.5), 0.0, 0.0, 0.0];
        }
        let slope = |k: usize| read * per * (above[k] - up / away * beyond[k]) / away;
        [read * row, slope(0), slope(1), slope(2)]
    }
}

/// The frames before and after one of so many, as a place and the places of the two whose line goes on where the film ends.
pub(in crate::identify) fn beside(frame: usize, frames: usize) -> [Beside; 2] {
    let before = match frame {
        0 => Beside::Beyond(1.min(frames - 1)),
        _ => Beside::At(frame - 1),
    };
    let after = match frame + 1 < frames {
        true => Beside::At(frame + 1),
        false => Beside::Beyond(frame.saturating_sub(1)),
    };
    [before, after]
}

/// A frame beside another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::identify) enum Beside {
    /// It is in the film.
    At(usize),
    /// It is not: as far beyond as the frame of this number is on the other side.
    Beyond(usize),
}

/// The mean of tensors of one shape.
///
/// # Errors
/// Never for `f32` and `f64`.
pub(in crate::identify) fn mean(all: &[Tensor]) -> Result<Tensor> {
    let [only] = all else {
        let mut sum = all[0].to_vec()?;
        for other in &all[1..] {
            sum.iter_mut().zip(other.to_vec()?).for_each(|(sum, value)| *sum += value);
        }
        let share = 1.0 / all.len() as f64;
        let dtype: DType = all[0].dtype();
        return Tensor::from_vec(sum.into_iter().map(|x| x * share).collect(), all[0].dims()).cast(dtype);
    };
    Ok(only.clone())
}
