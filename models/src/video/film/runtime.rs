//! Interface to the ONNX runtime: checks its inputs and turns its failures into errors.

use std::any::Any;
use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::Path;

use gradreel::io::foreign;
use gradreel::{Error, ErrorKind, Result};
use rten::{DataType, Dimension, LoadErrorKind, Model, Value, ValueType};

use super::onnx;
use crate::text;

/// Accepted side lengths of a network's input \[pixels\].
pub(super) const SIDES: RangeInclusive<usize> = 16..=4096;

/// Maximum size of a network \[bytes\].
const MOST_BYTES: u64 = 4 << 30;

/// Stack size for the recursion through the largest accepted network \[bytes\].
const STACK: usize = 256 << 20;

/// A network that maps a picture of three channels to one value per pixel.
pub(super) struct Network<'a> {
    model: Model,
    path: &'a Path,
    /// Width and height of its input.
    pub sides: [usize; 2],
}

impl<'a> Network<'a> {
    /// Reads a network; `open` is the width and height of the input where the network leaves them open.
    pub fn read(path: &'a Path, open: [usize; 2]) -> Result<Self> {
        let fix = "give the path of an ONNX file (--matting FILE)";
        if path.exists() && !path.is_file() {
            return Err(unreadable(path, "a folder or a device").fix(fix));
        }
        let bytes = text::bytes(path, "the matting network", fix, MOST_BYTES)?;
        if let Some(error) = foreign(&bytes, "an ONNX file with a network for matting (--matting FILE)") {
            return Err(error.at(path.display()));
        }
        onnx::check(&bytes).map_err(|found| unreadable(path, found).fix("copy or export the file again"))?;
        let model = Model::load(bytes).map_err(|e| {
            unreadable(path, &e).fix(match e.kind() {
                LoadErrorKind::OperatorInvalid => {
                    "export it with standard operators (opset 11 to 17), or take another network"
                }
                LoadErrorKind::ExternalDataError => "save it with its weights in the same file",
                _ => "copy or export the file again",
            })
        })?;
        let sides = sides(&model, path, open)?;
        Ok(Self { model, path, sides })
    }

    /// Width, height and values of the output for a picture `[3, height, width]`.
    pub fn run(&self, picture: Vec<f32>) -> Result<([usize; 2], Vec<f32>)> {
        let [width, height] = self.sides;
        let input = Value::from_shape([1, 3, height, width], picture).map_err(|e| unusable(self.path, e))?;
        let output = self.model.run_one(input.into(), None).map_err(|e| unusable(self.path, e))?;
        let (sides, values) = only_channel(self.path, output)?;
        match values.iter().find(|value| !value.is_finite()) {
            None => Ok((sides, values)),
            Some(value) => {
                Err(Error::new(ErrorKind::NonFinite, "the matting network gives numbers that are not finite")
                    .at(self.path.display())
                    .found(value)
                    .wanted("the object's share of each pixel")
                    .fix("check clip.film.matting.mean and deviation, or take another network"))
            }
        }
    }
}

/// Runs `run` with the network at `path`.
///
/// The runtime may panic on malformed files and recurses along operator chains. A separate thread with a large
/// stack turns either into an error.
pub(super) fn guarded<T: Send>(path: &Path, run: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().name("matting".to_owned()).stack_size(STACK).spawn_scoped(scope, run);
        let thread = thread.map_err(|e| {
            Error::new(ErrorKind::Io, "cannot start the matting network")
                .at(path.display())
                .found(e)
                .fix("end other programs, and try again")
        })?;
        thread.join().unwrap_or_else(|panic| Err(unusable(path, words(&*panic))))
    })
}

/// Width and height of a network's input.
fn sides(model: &Model, path: &Path, open: [usize; 2]) -> Result<[usize; 2]> {
    let wrong = |found: String| {
        Error::new(ErrorKind::Input, "the network is not one for matting")
            .at(path.display())
            .found(found)
            .wanted(format!(
                "one picture [1, 3, height, width] of float32 numbers as its only input, sides of {} to {} pixels, and an output",
                SIDES.start(),
                SIDES.end()
            ))
            .fix("export it with this input, or take another network")
    };
    let ([input], [_, ..]) = (model.input_ids(), model.output_ids()) else {
        return Err(wrong(format!("{} inputs and {} outputs", model.input_ids().len(), model.output_ids().len())));
    };
    let fixed = |side: &Dimension| if let Dimension::Fixed(side) = side { Some(*side) } else { None };
    let shape = model.input_shape(0).map_or(vec![None; 4], |shape| shape.iter().map(fixed).collect());
    let kind = model.node_info(*input).and_then(|info| info.dtype());
    match shape[..] {
        [None | Some(1), None | Some(3), height, width]
            if kind.is_none_or(|kind| kind == ValueType::Tensor(DataType::Float)) =>
        {
            let sides = [width.unwrap_or(open[0]), height.unwrap_or(open[1])];
            match sides.iter().all(|side| SIDES.contains(side)) {
                true => Ok(sides),
                false => Err(wrong(format!("pictures of {} × {} pixels", sides[0], sides[1]))),
            }
        }
        _ => {
            let shape: Vec<_> = shape.iter().map(|side| side.map_or("?".into(), |side| side.to_string())).collect();
            let kind = kind.map(|kind| format!(" of {kind}")).unwrap_or_default();
            Err(wrong(format!("[{}]{kind}", shape.join(", "))))
        }
    }
}

/// Width, height and values of a picture of one channel.
fn only_channel(path: &Path, output: Value) -> Result<([usize; 2], Vec<f32>)> {
    let wrong = |found: String| {
        Error::new(ErrorKind::Input, "the network does not make mattes")
            .at(path.display())
            .found(found)
            .wanted("[1, 1, height, width] or [1, height, width] of float32 numbers as its first output")
            .fix("take a network for matting or salient objects, or export it with the matte as its first output")
    };
    let of_four = output.clone().into_shape_vec::<f32, 4>().ok().map(|(shape, values)| (shape.to_vec(), values));
    let (shape, values) = match of_four {
        Some(found) => found,
        None => {
            let (shape, values) = output.into_shape_vec::<f32, 3>().map_err(|e| wrong(e.to_string()))?;
            (shape.to_vec(), values)
        }
    };
    match shape[..] {
        [1, 1, height, width] | [1, height, width] if !values.is_empty() => Ok(([width, height], values)),
        _ => Err(wrong(format!("{shape:?}"))),
    }
}

fn unreadable(path: &Path, found: impl Display) -> Error {
    Error::new(ErrorKind::Input, "cannot read the matting network")
        .at(path.display())
        .found(found)
        .wanted("an ONNX file with a network for matting, weights included (--matting FILE)")
}

fn unusable(path: &Path, found: impl Display) -> Error {
    Error::new(ErrorKind::Input, "the matting network cannot be run")
        .at(path.display())
        .found(found)
        .wanted("a network for matting that takes one picture [1, 3, height, width]")
        .fix("copy or export it again, give clip.film.matting.size if it wants another size, or take another network")
}

/// The message of a panic.
fn words(panic: &(dyn Any + Send)) -> &str {
    let owned = panic.downcast_ref::<String>().map(String::as_str);
    owned.or(panic.downcast_ref::<&str>().copied()).unwrap_or("a fault without a word")
}
