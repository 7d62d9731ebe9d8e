//! Maximum pooling as two ops that are each other's derivative, to any order: `max_pick` takes from one image the values at
//! the places where another has its maxima, `max_unpool` puts values there. Pooling picks from an image at its own maxima.
//! A window's place is that of its first NaN or, without one, of its first maximum; it does not move under small changes.

use std::rc::Rc;

use rayon::prelude::*;

use crate::backend::cpu::buffer;
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::pool::{Pool, Windows};
use crate::ops::{Case, Entry, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Error, ErrorKind, Result, Spec, Tensor};

pub(super) const PICK_ENTRY: Entry = Entry { name: "max_pick", gpu: true, cases: || cases(false) };
pub(super) const UNPOOL_ENTRY: Entry = Entry { name: "max_unpool", gpu: true, cases: || cases(true) };

const TEXT: &str = include_str!("../../kernels/max_pool.wgsl");
pub(super) static PICK: Kernel = Kernel::new("max_pool", "pick", TEXT, &["y", "values", "x"]);
pub(super) static UNPOOL: Kernel = Kernel::new("max_pool", "unpool", TEXT, &["y", "values", "x"]);

fn cases(unpools: bool) -> Vec<Case> {
    let case = |settings: Pool, dims: &[usize]| {
        let image = uniform(2, dims, -1.0..1.0);
        let pooled = MaxPool { settings: settings.clone(), unpools: false }.infer(&[image.spec(), image.spec()]);
        let shape = if unpools { pooled.expect("settings that fit").shape } else { dims.into() };
        Case::new(MaxPool { settings, unpools }, [uniform(1, shape, -1.0..1.0), image])
    };
    vec![
        case(Pool::new(2), &[2, 2, 5]),
        case(Pool::new(3).stride(2).padding(1), &[1, 2, 5, 6]),
        case(Pool::new([3, 2]).stride(1).padding([1, 0]), &[1, 1, 3, 4]),
        case(Pool::new([2, 3, 2]).stride([1, 2, 2]).padding([1, 1, 0]), &[1, 2, 3, 4, 5]),
        case(Pool::new(1), &[0, 2, 3, 3]),
    ]
}

/// Operands: values to pick from (shape of the image) or to put in place (shape of the pooled image), and the image.
#[derive(Debug, Clone)]
struct MaxPool {
    settings: Pool,
    unpools: bool,
}

impl MaxPool {
    fn pooled(image: &Spec, windows: &Windows) -> Spec {
        let dims = image.shape.dims();
        Spec::new([&dims[..2], &windows.y[3 - windows.rank..]].concat(), image.dtype)
    }

    fn run<T: Real>(&self, windows: &Windows, values: &[T], image: &[T]) -> Vec<T> {
        let [pixels, count] = windows.volumes();
        let (from, to) = if self.unpools { (count, pixels) } else { (pixels, count) };
        let mut result = buffer::<T>(windows.planes * to);
        let planes = result.par_chunks_mut(to).zip(values.par_chunks(from)).zip(image.par_chunks(pixels));
        planes.for_each_init(
            || (vec![T::ZERO; windows.y[2]], vec![0; count]),
            |(best, places), ((out, values), image)| {
                find(windows, image, best, places);
                if self.unpools {
                    out.fill(T::ZERO);
                    places.iter().zip(values).for_each(|(&place, &value)| out[place as usize] += value);
                } else {
                    out.iter_mut().zip(&*places).for_each(|(out, &place)| *out = values[place as usize]);
                }
            },
        );
        result
    }
}

/// Finds the place of every window of a plane, row by row. `best` is scratch for one row.
#[allow(clippy::cast_possible_truncation)]
fn find<T: Real>(windows: &Windows, image: &[T], best: &mut [T], places: &mut [u32]) {
    let Windows { x, y, kernel, stride, padding, .. } = windows;
    for (number, places) in places.chunks_exact_mut(y[2]).enumerate() {
        let (depth, height) = (windows.window(0, number / y[1]), windows.window(1, number % y[1]));
        best.fill(-T::INFINITY);
        for (i, place) in places.iter_mut().enumerate() {
            *place = ((depth.start * x[1] + height.start) * x[2] + windows.window(2, i).start) as u32;
        }
        for d in depth {
            for h in height.clone() {
                let row = (d * x[1] + h) * x[2];
                for tap in 0..kernel[2] {
                    // windows whose tap lies in the image
                    let from = padding[2].saturating_sub(tap).div_ceil(stride[2]);
                    let to = (x[2] + padding[2]).saturating_sub(tap).div_ceil(stride[2]).min(y[2]);
                    for i in from..to {
                        let at = row + i * stride[2] + tap - padding[2];
                        let value = image[at];
                        if (value > best[i] || value.is_nan()) && !best[i].is_nan() {
                            best[i] = value;
                            places[i] = at as u32;
                        }
                    }
                }
            }
        }
    }
}

impl Op for MaxPool {
    fn name(&self) -> &'static str {
        if self.unpools { "max_unpool" } else { "max_pick" }
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [values, image] = Spec::exactly(self.name(), inputs)?;
        let pooled = Self::pooled(image, &self.settings.windows(self.name(), image)?);
        let (wanted, result) = if self.unpools { (pooled, image.clone()) } else { (image.clone(), pooled) };
        if *values != wanted {
            return Err(Error::new(ErrorKind::Shape, format!("{}: the operands do not fit", self.name()))
                .found(format!("{values:?} for {image:?}"))
                .wanted(format!("{wanted:?}")));
        }
        Ok(result)
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let [values, image] = inputs.array();
        let result = self.infer(&[values.spec(), image.spec()])?;
        let windows = self.settings.windows(self.name(), &image.spec())?;
        for_real!(result.dtype, T => {
            Ok(Tensor::from_vec(self.run::<T>(&windows, values.slice(), image.slice()), result.shape).into())
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let [values, image] = inputs.array();
        let result = self.infer(&[values.spec(), image.spec()])?;
        let windows = self.settings.windows(self.name(), &image.spec())?;
        let len = result.shape.len();
        let mut sizes = words([len, 0, 0, 0]).to_vec();
        for axis in [windows.x, windows.y, windows.kernel, windows.stride, windows.padding] {
            sizes.extend(words([axis[0], axis[1], axis[2], 0]));
        }
        let kernel = if self.unpools { &UNPOOL } else { &PICK };
        Ok(gpu.launch(kernel, &[values, image], &sizes, result, Work::Invocations(len))?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing().input(1)
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let image = cx.input(1);
        let opposite = Self { unpools: !self.unpools, ..self.clone() };
        // places do not move under small changes of the image
        let still = || -> Result<Var> {
            let zeros = Tensor::zeros(image.shape(), image.dtype()).to_device(&image.device())?;
            Ok(image.tape().constant(zeros))
        };
        Ok(vec![
            cx.wants(0).then(|| Var::run(Rc::new(opposite), &[cx.gradient(), image])),
            cx.wants(1).then(still).transpose()?,
        ])
    }
}

impl Var {
    /// The largest value of every window of images `[batch, channels, …]`; NaN where a window holds one. The gradient goes to
    /// the first of equal maxima. Differentiable any number of times.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::Pool};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0f64, 7.0, 7.0, 6.0], [1, 1, 2, 2]));
    /// let y = x.max_pool(&Pool::new(2));
    /// assert_eq!(y.item()?, 7.0);
    /// assert_eq!(y.sum_all().backward()?.wrt(&x)?.slice::<f64>(), [0.0, 1.0, 0.0, 0.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the settings do not fit the shape.
    #[track_caller]
    #[must_use]
    pub fn max_pool(&self, settings: &Pool) -> Self {
        Self::run(Rc::new(MaxPool { settings: settings.clone(), unpools: false }), &[self, &self.detach()])
    }
}
