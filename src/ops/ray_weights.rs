//! `ray_weights`: how much each sample of a ray contributes to its pixel.

use std::rc::Rc;

use crate::backend::cpu::rays;
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::segments::{are_offsets, check_offsets};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Device, Error, ErrorKind, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "ray_weights",
    gpu: true,
    cases: || cases().into_iter().map(|(stop, inputs)| Case::new(RayWeights { stop }, inputs)).collect(),
};

/// Rays without samples, opaque samples, rays that end early, and no rays at all.
pub(super) fn cases() -> Vec<(Option<f64>, [Tensor; 2])> {
    let offsets = |list: &[u32]| Tensor::from_vec(list.to_vec(), [list.len()]);
    let some = uniform(1, [9], 0.05..0.9);
    let opaque = Tensor::from_vec(vec![0.3f64, 1.0, 0.2, 1.0, 0.0, 1.0, 1.0], [7]);
    vec![
        (None, [some.clone(), offsets(&[0, 0, 4, 5, 5, 9])]),
        (Some(0.2), [some, offsets(&[0, 6, 9])]),
        (None, [opaque, offsets(&[0, 3, 4, 7])]),
        (Some(1e-3), [Tensor::from_vec(Vec::<f64>::new(), [0]), offsets(&[0])]),
    ]
}

const TEXT: &str = include_str!("../../kernels/ray_weights.wgsl");
/// Weights, one ray per invocation.
pub(super) static WEIGHTS: Kernel = Kernel::new("ray_weights", "weights", TEXT, &["y", "alpha", "offsets"]);
/// Their adjoint.
pub(super) static SLOPE: Kernel = Kernel::new("ray_weights", "slope", TEXT, &["y", "alpha", "offsets", "g"]);

#[derive(Debug)]
struct RayWeights {
    stop: Option<f64>,
}

/// Sizes and threshold for the kernels of rays.
pub(super) fn ray_words(offsets: &Tensor, stop: Option<f64>) -> [u32; 2] {
    let [rays] = words([offsets.len() - 1]);
    [rays, stop.map_or(f32::MIN, |stop| stop as f32).to_bits()]
}

/// Fails unless the operands are opacities and offsets.
pub(super) fn check_rays(op: &str, inputs: &[Spec]) -> Result<()> {
    let [alpha, offsets] = Spec::exactly(op, inputs)?;
    if alpha.shape.rank() == 1 && are_offsets(offsets) && alpha.dtype.is_real() {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Shape, format!("{op}: the operands do not fit"))
        .found(format!("{alpha:?} by {offsets:?}"))
        .wanted("opacities [samples] by offsets [rays + 1], u32"))
}

impl Op for RayWeights {
    fn name(&self) -> &'static str {
        "ray_weights"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        check_rays(self.name(), inputs)?;
        Ok(inputs[0].clone())
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let [alpha, offsets] = inputs.array();
        check_offsets(self.name(), offsets.slice(), alpha.len())?;
        for_real!(alpha.dtype(), T => {
            let weights = rays::weights::<T>(alpha.slice(), offsets.slice(), self.stop);
            Ok(Tensor::from_vec(weights, alpha.shape()).into())
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let [alpha, offsets] = inputs.array();
        check_offsets(self.name(), offsets.gpu_buffer().indices()?, alpha.len())?;
        let work = Work::Invocations(offsets.len() - 1);
        Ok(gpu.launch(&WEIGHTS, &[alpha, offsets], &ray_words(offsets, self.stop), alpha.spec(), work)?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::inputs()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        cx.first_order_only(self.name())?;
        let (alpha, offsets, g) = (cx.input(0).tensor(), cx.input(1).tensor(), cx.gradient().tensor());
        let slope = match alpha.device() {
            Device::Gpu(gpu) => {
                let work = Work::Invocations(offsets.len() - 1);
                gpu.launch(&SLOPE, &[alpha, offsets, g], &ray_words(offsets, self.stop), alpha.spec(), work)?
            }
            Device::Cpu => for_real!(alpha.dtype(), T => {
                let rays = rays::Cotangents { weights: Some(g.slice::<T>()), left: None };
                Tensor::from_vec(rays::slope(alpha.slice(), offsets.slice(), rays, self.stop), alpha.shape())
            }),
        };
        Ok(vec![Some(cx.input(0).tape().constant(slope)), None])
    }
}

impl Var {
    /// The weights with which the samples of rays contribute to their pixels: `w_k = T_k α_k` with the transmittance
    /// `T_k = Π_{j<k} (1 − α_j)` of the samples before it on the same ray, front to back.
    ///
    /// `self` holds the opacities α in 0…1 of the samples of all rays, `[samples]`; ray `r` has those from `offsets[r]` to
    /// before `offsets[r + 1]` ([`segment_offsets`](crate::ops::segment_offsets) makes offsets of ray numbers). With `stop`,
    /// a ray ends after the sample behind which less than this is left: later weights are 0. Together with
    /// [`Var::ray_transmittance`] the weights of a ray add up to 1. Differentiable once; no division, so an opacity of
    /// exactly 1 has its derivative, too.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let alpha = tape.leaf(Tensor::from_vec(vec![0.5f64, 0.5, 1.0], [3]));
    /// let rays = tape.constant(Tensor::from_vec(vec![0u32, 2, 3], [3]));
    /// assert_eq!(alpha.ray_weights(&rays, None)?.value()?.slice::<f64>(), &[0.5, 0.25, 1.0]);
    /// assert_eq!(alpha.ray_transmittance(&rays, None)?.value()?.slice::<f64>(), &[0.25, 0.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the offsets fall somewhere, or are not those of the samples.
    ///
    /// # Panics
    /// When the operands are not a list of numbers and a list of `u32`.
    #[track_caller]
    pub fn ray_weights(&self, offsets: &Self, stop: Option<f64>) -> Result<Self> {
        self.tape().apply(Rc::new(RayWeights { stop }), &[self, offsets])
    }
}
