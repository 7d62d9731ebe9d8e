//! `to_device`: the same numbers on another device, in the middle of a model.

use std::rc::Rc;

use crate::backend::gpu::Gpu;
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::{Device, Result, Spec};

#[derive(Debug)]
struct ToDevice {
    device: Device,
}

impl Op for ToDevice {
    fn name(&self) -> &'static str {
        "to_device"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [x] = Spec::exactly(self.name(), inputs)?;
        Ok(x.clone())
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        Ok(inputs[0].to_device(&self.device)?.into())
    }

    fn forward_gpu(&self, _gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        self.forward_cpu(inputs)
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        Ok(vec![Some(cx.gradient().to_device(&cx.input(0).device()))])
    }
}

impl Var {
    /// The same numbers on another device; the gradient comes back to where this variable lives. With it, a stage that runs
    /// on one backend only can stand in the middle of a model.
    ///
    /// ```
    /// use gradreel::{Device, Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![3.0f32], [1]));
    /// let there = Device::gpu().unwrap_or(Device::Cpu);
    /// let y = x.to_device(&there).square().to_device(&Device::Cpu);
    /// assert_eq!(y.sum_all().backward()?.wrt(&x)?.slice::<f32>(), &[6.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn to_device(&self, device: &Device) -> Self {
        if self.device() == *device {
            return self.clone();
        }
        Self::run(Rc::new(ToDevice { device: device.clone() }), &[self])
    }
}
