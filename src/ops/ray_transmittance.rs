//! `ray_transmittance`: how much of what lies behind all samples of a ray is seen.

use std::rc::Rc;

use crate::backend::cpu::rays;
use crate::backend::gpu::{Gpu, Kernel, Work};
use crate::ops::ray_weights::{cases, check_rays, ray_words};
use crate::ops::segments::check_offsets;
use crate::ops::{Case, Entry};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Device, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "ray_transmittance",
    gpu: true,
    cases: || cases().into_iter().map(|(stop, inputs)| Case::new(RayTransmittance { stop }, inputs)).collect(),
};

const TEXT: &str = include_str!("../../kernels/ray_transmittance.wgsl");
/// What is left, one ray per invocation.
pub(super) static LEFT: Kernel = Kernel::new("ray_transmittance", "left", TEXT, &["y", "alpha", "offsets"]);
/// Its adjoint.
pub(super) static SLOPE: Kernel = Kernel::new("ray_transmittance", "slope", TEXT, &["y", "alpha", "offsets", "g"]);

#[derive(Debug)]
struct RayTransmittance {
    stop: Option<f64>,
}

impl Op for RayTransmittance {
    fn name(&self) -> &'static str {
        "ray_transmittance"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        check_rays(self.name(), inputs)?;
        Ok(Spec::new([inputs[1].shape.len() - 1], inputs[0].dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let [alpha, offsets] = inputs.array();
        check_offsets(self.name(), offsets.slice(), alpha.len())?;
        for_real!(alpha.dtype(), T => {
            let left = rays::transmittance::<T>(alpha.slice(), offsets.slice(), self.stop);
            Ok(Tensor::from_vec(left, [offsets.len() - 1]).into())
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let [alpha, offsets] = inputs.array();
        check_offsets(self.name(), offsets.gpu_buffer().indices()?, alpha.len())?;
        let rays = offsets.len() - 1;
        let result = Spec::new([rays], alpha.dtype());
        let words = ray_words(offsets, self.stop);
        Ok(gpu.launch(&LEFT, &[alpha, offsets], &words, result, Work::Invocations(rays))?.into())
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
                let rays = rays::Cotangents { weights: None, left: Some(g.slice::<T>()) };
                Tensor::from_vec(rays::slope(alpha.slice(), offsets.slice(), rays, self.stop), alpha.shape())
            }),
        };
        Ok(vec![Some(cx.input(0).tape().constant(slope)), None])
    }
}

impl Var {
    /// The transmittance that is left behind all samples of each ray, `Π (1 − α_k)`: `[rays]`, with opacities, offsets and
    /// threshold as [`Var::ray_weights`] has them. A ray that ends early keeps what was left there. Differentiable once.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let opacities = tape.leaf(Tensor::from_vec(vec![0.5, 0.5, 0.25], [3]));
    /// // two samples on the first ray, one on the second
    /// let offsets = tape.constant(Tensor::from_vec(vec![0u32, 2, 3], [3]));
    /// assert_eq!(opacities.ray_transmittance(&offsets, None)?.value()?.slice::<f64>(), [0.25, 0.75]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`](crate::ErrorKind::Input) when the offsets fall somewhere, or are not those of the samples.
    ///
    /// # Panics
    /// When the operands are not a list of numbers and a list of `u32`.
    #[track_caller]
    pub fn ray_transmittance(&self, offsets: &Self, stop: Option<f64>) -> Result<Self> {
        self.tape().apply(Rc::new(RayTransmittance { stop }), &[self, offsets])
    }
}
