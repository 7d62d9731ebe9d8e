//! Device checks: an op on another device against the CPU, forward and backward.

use std::fmt;

use crate::tape::gradcheck::contract;
use crate::tape::{Tape, Var};
use crate::{DType, Device, Error, ErrorKind, Result, Tensor};

/// The outcome of a device check: one row for the value and one for the gradient of each real input. Prints as a table.
///
/// ```
/// use gradreel::{Device, Tensor, devicecheck};
///
/// // the CPU against itself
/// let x = Tensor::from_vec(vec![0.3f32, -1.2], [2]);
/// let report = devicecheck("tanh", &Device::Cpu, &[("x", x)], 2e-6, |_, v| Ok(v[0].tanh()))?;
/// assert_eq!(report.rows.len(), 2);
/// println!("{report}");
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct DeviceReport {
    /// What was checked.
    pub name: String,
    /// Where it was compared with the CPU.
    pub device: String,
    /// What was found.
    pub rows: Vec<DeviceRow>,
}

/// How far a result on a device is from that of the CPU.
///
/// ```
/// use gradreel::{Device, Tensor, devicecheck};
///
/// // the CPU against itself
/// let x = Tensor::from_vec(vec![0.3f32, -1.2], [2]);
/// let report = devicecheck("tanh", &Device::Cpu, &[("x", x)], 2e-6, |_, v| Ok(v[0].tanh()))?;
/// assert_eq!(report.rows[1].what, "gradient of x");
/// assert_eq!(report.rows[1].difference, 0.0);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct DeviceRow {
    /// `value`, or `gradient of` an input.
    pub what: String,
    /// The largest difference in units of `max(1, |x|)`; NaN where one of the two is NaN or infinite and the other is
    /// not.
    pub difference: f64,
    /// Where it is.
    pub at: Vec<usize>,
    /// Whether it is within the tolerance.
    pub passed: bool,
}

/// Compares a function's value and gradients on a device with those on the CPU.
///
/// `f64` inputs are cast to `f32` for both; `u32` inputs are constants. The result is contracted with fixed pseudo-random
/// weights to a single number, whose gradients are compared. `tolerance` is relative to `max(1, |x|)`; 2e-6 fits what
/// rounds each number a few times.
///
/// ```
/// use gradreel::{Device, Tensor, devicecheck};
///
/// if let Ok(gpu) = Device::gpu() {
///     let x = Tensor::from_vec(vec![0.3f32, -1.2, 4.0], [3]);
///     let report = devicecheck("x tanh(x)", &gpu, &[("x", x)], 2e-6, |_, v| Ok(&v[0] * &v[0].tanh()))?;
///     assert!(report.passed(), "{report}");
/// }
/// # Ok::<(), gradreel::Error>(())
/// ```
///
/// # Errors
/// What the function and its derivative return on either device; [`ErrorKind::Shape`] when a result has another shape.
pub fn devicecheck(
    name: &str,
    device: &Device,
    inputs: &[(&str, Tensor)],
    tolerance: f64,
    function: impl Fn(&Tape, &[Var]) -> Result<Var>,
) -> Result<DeviceReport> {
    let run = |device: &Device| -> Result<Vec<Tensor>> {
        let tape = Tape::new();
        let mut vars = Vec::with_capacity(inputs.len());
        for (_, x) in inputs {
            let real = x.dtype() != DType::U32;
            let x = if real { x.cast(DType::F32)? } else { x.clone() }.to_device(device)?;
            vars.push(if real { tape.leaf(x) } else { tape.constant(x) });
        }
        let y = function(&tape, &vars)?;
        let value = y.value()?.to_device(&Device::Cpu)?;
        let gradients = contract(&y).backward()?;
        let of = |x: &Var| gradients.wrt(x)?.to_device(&Device::Cpu);
        std::iter::once(Ok(value)).chain(vars.iter().filter(|x| x.is_differentiable()).map(of)).collect()
    };
    let (here, there) = (run(&Device::Cpu)?, run(device)?);
    let real = inputs.iter().filter(|(_, x)| x.dtype() != DType::U32);
    let names = std::iter::once("value".to_owned()).chain(real.map(|(input, _)| format!("gradient of {input}")));
    let rows = names.zip(here.iter().zip(&there)).map(|(what, (here, there))| row(what, here, there, tolerance));
    Ok(DeviceReport { name: name.to_owned(), device: device.to_string(), rows: rows.collect::<Result<_>>()? })
}

fn row(what: String, here: &Tensor, there: &Tensor, tolerance: f64) -> Result<DeviceRow> {
    if here.spec() != there.spec() {
        return Err(Error::new(ErrorKind::Shape, format!("the {what} has another shape than on the CPU"))
            .found(format!("{:?}", there.spec()))
            .wanted(format!("{:?}", here.spec())));
    }
    let mut row = DeviceRow { what, difference: 0.0, at: Vec::new(), passed: true };
    for (place, (a, b)) in here.to_vec()?.into_iter().zip(there.to_vec()?).enumerate() {
        let same = a == b || (a.is_nan() && b.is_nan());
        let difference = if same { 0.0 } else { (a - b).abs() / a.abs().max(1.0) };
        let difference = if difference.is_finite() { difference } else { f64::NAN };
        if row.at.is_empty() || difference > row.difference || difference.is_nan() {
            (row.difference, row.at) = (difference, here.shape().index(place));
        }
        if difference.is_nan() {
            break;
        }
    }
    row.passed = row.difference <= tolerance;
    Ok(row)
}

impl DeviceReport {
    /// Whether every row is within the tolerance.
    ///
    /// ```
    /// use gradreel::{Device, Tensor, devicecheck};
    ///
    /// // the CPU against itself
    /// let x = Tensor::from_vec(vec![0.3f32, -1.2], [2]);
    /// let report = devicecheck("tanh", &Device::Cpu, &[("x", x)], 2e-6, |_, v| Ok(v[0].tanh()))?;
    /// assert!(report.passed());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn passed(&self) -> bool {
        self.rows.iter().all(|row| row.passed)
    }
}

impl fmt::Display for DeviceReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "devicecheck {}   f32 on {} against the CPU", self.name, self.device)?;
        for DeviceRow { what, difference, at, passed } in &self.rows {
            let result = if *passed { "ok" } else { "FAIL" };
            writeln!(f, "  {what:<24} {difference:>10.1e}   {:<14} {result}", format!("{at:?}"))?;
        }
        Ok(())
    }
}
