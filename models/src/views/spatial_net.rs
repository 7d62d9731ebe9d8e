//! The 3D network that fuses all un-projected views into one spatial volume.

use gradreel::{Result, Var};

use crate::layers::{Convolution, GroupNorm, Kernel, Scope, Segment, per_channel};

/// The sizes of the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SpatialSizes {
    /// Channels of the un-projected volume: views × features.
    pub inputs: usize,
    /// Channels at full, half, quarter and eighth resolution.
    pub widths: [usize; 4],
    /// Channels of the time vector.
    pub time: usize,
}

/// An encoder–decoder on volumes with additive skips, conditioned on time at every stage.
pub struct SpatialNet {
    into: Convolution,
    first: Segment<Unit>,
    down: [[Segment<Unit>; 3]; 3],
    up: [Segment<Unit>; 3],
}

/// `conv(SiLU(GN(x + t)))`, without residual.
struct Unit {
    time: Convolution,
    norm: GroupNorm,
    conv: Convolution,
}

impl Unit {
    fn new(scope: &Scope<'_>, time: usize, kernel: Kernel, inputs: usize) -> Result<Self> {
        Ok(Self {
            time: Convolution::new(&scope.at("t_conv"), Kernel::volume(time, inputs, 1))?,
            norm: GroupNorm::new(&scope.at("bn"), 8, inputs, 1e-5)?,
            conv: Convolution::new(&scope.at("conv"), kernel)?,
        })
    }

    fn up(scope: &Scope<'_>, time: usize, inputs: usize, outputs: usize) -> Result<Self> {
        Ok(Self {
            time: Convolution::new(&scope.at("t_conv"), Kernel::volume(time, inputs, 1))?,
            norm: GroupNorm::new(&scope.at("norm"), 8, inputs, 1e-5)?,
            conv: Convolution::doubling(&scope.at("conv"), Kernel::volume(inputs, outputs, 3))?,
        })
    }

    fn forward(&self, x: &Var, time: &Var) -> Var {
        self.conv.forward(&self.norm.silu(&(x + &self.time.forward(time))))
    }
}

impl SpatialNet {
    /// Builds the network from the weights at a scope.
    ///
    /// # Errors
    /// If a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, sizes: SpatialSizes) -> Result<Self> {
        let SpatialSizes { inputs, widths, time } = sizes;
        let unit = |name: &str, inputs, outputs, stride| {
            let kernel = Kernel::volume(inputs, outputs, 3).stride(stride);
            Segment::new(&scope.at(name), move |scope| Unit::new(scope, time, kernel, inputs))
        };
        let down = |level: usize, names: [&str; 3]| -> Result<[Segment<Unit>; 3]> {
            let [from, to] = [widths[level], widths[level + 1]];
            Ok([unit(names[0], from, to, 2)?, unit(names[1], to, to, 1)?, unit(names[2], to, to, 1)?])
        };
        let up = |level: usize, name: &str| {
            let [from, to] = [widths[level + 1], widths[level]];
            Segment::new(&scope.at(name), move |scope| Unit::up(scope, time, from, to))
        };
        Ok(Self {
            into: Convolution::new(&scope.at("init_conv"), Kernel::volume(inputs, widths[0], 3))?,
            first: unit("conv0", widths[0], widths[0], 1)?,
            down: [
                down(0, ["conv1", "conv2_0", "conv2_1"])?,
                down(1, ["conv3", "conv4_0", "conv4_1"])?,
                down(2, ["conv5", "conv6_0", "conv6_1"])?,
            ],
            up: [up(2, "conv7")?, up(1, "conv8")?, up(0, "conv9")?],
        })
    }

    /// `x [b, inputs, v, v, v]` and time vectors `[b, time]` to `[b, widths[0], v, v, v]`; v is a multiple of 8.
    ///
    /// # Errors
    /// As [`Segment::run`].
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the network.
    #[track_caller]
    pub fn forward(&self, x: &Var, time: &Var) -> Result<Var> {
        let time = per_channel(time, 3);
        let run =
            |unit: &Segment<Unit>, x: &Var| unit.run(&[x, &time], |unit, inputs| unit.forward(&inputs[0], &inputs[1]));
        let mut levels = vec![run(&self.first, &self.into.forward(x))?];
        for units in &self.down {
            let mut h = levels[levels.len() - 1].clone();
            for unit in units {
                h = run(unit, &h)?;
            }
            levels.push(h);
        }
        let mut y = levels.pop().expect("four levels");
        for (unit, skip) in self.up.iter().zip(levels.iter().rev()) {
            y = skip + &run(unit, &y)?;
        }
        Ok(y)
    }
}
