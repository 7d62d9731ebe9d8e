//! The 3D network on a target view's frustum, which supplies a pyramid of volumes to the UNet.

use gradreel::{Result, Var};

use crate::layers::{Convolution, GroupNorm, Kernel, Scope, Segment, per_channel};

/// The sizes of the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrustumSizes {
    /// Channels of the spatial volume.
    pub inputs: usize,
    /// Channels at full, half, quarter and eighth resolution.
    pub widths: [usize; 4],
    /// Channels of the time vector.
    pub time: usize,
    /// Channels of the viewpoint embedding.
    pub view: usize,
}

/// An encoder–decoder on frustum volumes, conditioned on time and viewpoint at every stage.
pub struct FrustumNet {
    into: Convolution,
    down: [[Segment<Unit>; 2]; 3],
    up: [Segment<Unit>; 3],
}

/// `conv(SiLU(GN(x + t + v)))`, without residual.
struct Unit {
    time: Convolution,
    view: Convolution,
    norm: GroupNorm,
    conv: Convolution,
}

impl Unit {
    fn new(scope: &Scope<'_>, sizes: &FrustumSizes, inputs: usize, norm: &str, conv: Convolution) -> Result<Self> {
        Ok(Self {
            time: Convolution::new(&scope.at("t_conv"), Kernel::volume(sizes.time, inputs, 1))?,
            view: Convolution::new(&scope.at("v_conv"), Kernel::volume(sizes.view, inputs, 1))?,
            norm: GroupNorm::new(&scope.at(norm), 8, inputs, 1e-5)?,
            conv,
        })
    }

    fn forward(&self, x: &Var, time: &Var, view: &Var) -> Var {
        let told = &self.time.forward(time) + &self.view.forward(view);
        self.conv.forward(&self.norm.silu(&(x + &told)))
    }
}

impl FrustumNet {
    /// Builds the network from the weights at a scope.
    ///
    /// # Errors
    /// If a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, sizes: FrustumSizes) -> Result<Self> {
        let widths = sizes.widths;
        let unit = |name: &str, inputs, outputs, stride| {
            Segment::new(&scope.at(name), move |scope| {
                let kernel = Kernel::volume(inputs, outputs, 3).stride(stride);
                let conv = Convolution::new(&scope.at("conv"), kernel)?;
                Unit::new(scope, &sizes, inputs, "bn", conv)
            })
        };
        let down = |level: usize, names: [&str; 2]| -> Result<[Segment<Unit>; 2]> {
            let [from, to] = [widths[level], widths[level + 1]];
            Ok([unit(names[0], from, to, 2)?, unit(names[1], to, to, 1)?])
        };
        let up = |level: usize, name: &str| {
            let [from, to] = [widths[level + 1], widths[level]];
            Segment::new(&scope.at(name), move |scope| {
                let conv = Convolution::doubling(&scope.at("conv"), Kernel::volume(from, to, 3))?;
                Unit::new(scope, &sizes, from, "norm", conv)
            })
        };
        Ok(Self {
            into: Convolution::new(&scope.at("conv0"), Kernel::volume(sizes.inputs, widths[0], 3))?,
            down: [down(0, ["conv1", "conv2"])?, down(1, ["conv3", "conv4"])?, down(2, ["conv5", "conv6"])?],
            up: [up(2, "up0")?, up(1, "up1")?, up(0, "up2")?],
        })
    }

    /// `x [b, inputs, d, h, w]`, time vectors `[b, time]` and viewpoint embeddings `[b, view]` to four volumes,
    /// finest first: `[b, widths[i], d/2ⁱ, h/2ⁱ, w/2ⁱ]`.
    ///
    /// # Errors
    /// As [`Segment::run`].
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the network.
    #[track_caller]
    pub fn forward(&self, x: &Var, time: &Var, view: &Var) -> Result<[Var; 4]> {
        let [time, view] = [time, view].map(|vectors| per_channel(vectors, 3));
        let x0 = self.into.forward(x);
        let run = |unit: &Segment<Unit>, x: &Var| {
            unit.run(&[x, &time, &view], |unit, inputs| unit.forward(&inputs[0], &inputs[1], &inputs[2]))
        };
        let deeper = |x: &Var, units: &[Segment<Unit>; 2]| run(&units[1], &run(&units[0], x)?);
        let x1 = deeper(&x0, &self.down[0])?;
        let x2 = deeper(&x1, &self.down[1])?;
        let x3 = deeper(&x2, &self.down[2])?;
        let y2 = &run(&self.up[0], &x3)? + &x2;
        let y1 = &run(&self.up[1], &y2)? + &x1;
        let y0 = &run(&self.up[2], &y1)? + &x0;
        Ok([y0, y1, y2, x3])
    }
}
