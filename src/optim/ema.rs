//! A running average of parameters.

use std::collections::BTreeMap;

use crate::io::TensorFile;
use crate::optim::update::{Rule, update};
use crate::optim::{Params, state};
use crate::scalar::Real;
use crate::tensor::for_real;
use crate::{Device, Element, Error, ErrorKind, Result, Tensor};

/// The exponential moving average `a ← decay · a + (1 − decay) · x` of all parameters that are not frozen; it starts at the
/// parameters of the first update.
///
/// ```
/// use gradreel::optim::{Ema, Params};
/// use gradreel::Tensor;
/// let mut params = Params::new();
/// params.set("x", Tensor::from_vec(vec![1.0], [1]));
/// let mut ema = Ema::new(0.5);
/// ema.update(&params)?;
/// params.set("x", Tensor::from_vec(vec![3.0], [1]));
/// ema.update(&params)?;
/// assert_eq!(ema.averaged(&params).get("x")?.item()?, 2.0);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Ema {
    decay: f64,
    ramp: Option<u64>,
    steps: u64,
    averages: BTreeMap<String, Tensor>,
}

impl Ema {
    /// An average with this decay, 0.999 or 0.9999 for long trainings.
    ///
    /// ```
    /// use gradreel::optim::Ema;
    /// let ema = Ema::new(0.999);
    /// # let _ = ema;
    /// ```
    pub fn new(decay: f64) -> Self {
        Self { decay, ramp: None, steps: 0, averages: BTreeMap::new() }
    }

    /// Lowers the decay of update `n` to `(1 + n) / (steps + n)` where that is less, so that the parameters of a training's
    /// start are soon forgotten.
    ///
    /// ```
    /// use gradreel::optim::{Ema, Params};
    /// use gradreel::Tensor;
    /// let mut params = Params::new();
    /// let mut ema = Ema::new(0.999).with_ramp(4);
    /// for x in [9.0, 1.0] {
    ///     params.set("x", Tensor::from_vec(vec![x], [1]));
    ///     ema.update(&params)?;
    /// }
    /// // 2/5 of what was there
    /// assert!((ema.averaged(&params).get("x")?.item()? - (0.4 * 9.0 + 0.6 * 1.0)).abs() < 1e-12);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[must_use]
    pub fn with_ramp(mut self, steps: u64) -> Self {
        self.ramp = Some(steps.max(1));
        self
    }

    /// Takes the parameters after an optimiser's step into the average.
    ///
    /// ```
    /// use gradreel::optim::{Ema, Params};
    /// use gradreel::Tensor;
    /// let mut params = Params::new();
    /// params.set("x", Tensor::from_vec(vec![1.0], [1]));
    /// let mut ema = Ema::new(0.5);
    /// ema.update(&params)?;
    /// params.set("x", Tensor::from_vec(vec![3.0], [1]));
    /// ema.update(&params)?;
    /// assert_eq!(ema.averaged(&params).get("x")?.item()?, 2.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] when a parameter has changed its shape or dtype, [`ErrorKind::Device`] when one cannot be read
    /// back.
    pub fn update(&mut self, params: &Params) -> Result<()> {
        let n = self.steps as f64;
        let decay = self.ramp.map_or(self.decay, |steps| self.decay.min((1.0 + n) / (steps as f64 + n)));
        for (path, param) in params.iter().filter(|(path, param)| !params.is_frozen(path) && param.dtype().is_real()) {
            let param = param.to_device(&Device::Cpu)?;
            let Some(average) = self.averages.get_mut(path) else {
                self.averages.insert(path.to_owned(), param);
                continue;
            };
            if average.spec() != param.spec() {
                return Err(Error::new(ErrorKind::Shape, "a parameter no longer fits its average")
                    .at(path)
                    .found(format!("{:?}", param.spec()))
                    .wanted(format!("{:?}", average.spec())));
            }
            for_real!(param.dtype(), T => {
                let rule = Average { keep: T::from_f64(decay), take: T::from_f64(1.0 - decay) };
                update::<T, 0>(rule, average, &param, &mut [])?;
            });
        }
        self.steps += 1;
        Ok(())
    }

    /// The parameters with averages in the place of those that are averaged.
    ///
    /// ```
    /// use gradreel::optim::{Ema, Params};
    /// use gradreel::Tensor;
    /// let mut params = Params::new();
    /// params.set("x", Tensor::from_vec(vec![1.0], [1]));
    /// let mut ema = Ema::new(0.5);
    /// ema.update(&params)?;
    /// params.set("x", Tensor::from_vec(vec![3.0], [1]));
    /// ema.update(&params)?;
    /// let smooth = ema.averaged(&params);
    /// assert_eq!(smooth.get("x")?.item()?, 2.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn averaged(&self, params: &Params) -> Params {
        let mut averaged = params.clone();
        for (path, average) in &self.averages {
            averaged.set(path.clone(), average.clone());
        }
        averaged
    }

    /// Adds the averages (`ema.<path>`) and the number of updates (metadata `ema.step`) to a file.
    ///
    /// ```
    /// use gradreel::optim::{Ema, Params};
    /// use gradreel::Tensor;
    /// let mut params = Params::new();
    /// params.set("x", Tensor::from_vec(vec![1.0], [1]));
    /// let mut ema = Ema::new(0.5);
    /// ema.update(&params)?;
    /// params.set("x", Tensor::from_vec(vec![3.0], [1]));
    /// ema.update(&params)?;
    /// let mut file = gradreel::io::TensorFile::default();
    /// ema.save(&mut file);
    /// let mut again = Ema::new(0.5);
    /// again.restore(&file)?;
    /// assert_eq!(again.averaged(&params).get("x")?.item()?, 2.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn save(&self, file: &mut TensorFile) {
        file.metadata.insert("ema.step".to_owned(), self.steps.to_string());
        file.tensors.extend(self.averages.iter().map(|(path, average)| (format!("ema.{path}"), average.clone())));
    }

    /// Goes on from a file, bit for bit.
    ///
    /// ```
    /// use gradreel::optim::{Ema, Params};
    /// use gradreel::Tensor;
    /// let mut params = Params::new();
    /// params.set("x", Tensor::from_vec(vec![1.0], [1]));
    /// let mut ema = Ema::new(0.5);
    /// ema.update(&params)?;
    /// params.set("x", Tensor::from_vec(vec![3.0], [1]));
    /// ema.update(&params)?;
    /// let mut file = gradreel::io::TensorFile::default();
    /// ema.save(&mut file);
    /// let mut again = Ema::new(0.5);
    /// again.restore(&file)?;
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the file holds no averages; nothing is changed then.
    pub fn restore(&mut self, file: &TensorFile) -> Result<()> {
        self.steps = state::counter(file, "ema.step")?;
        let saved =
            file.tensors.iter().filter_map(|(name, t)| Some((name.strip_prefix("ema.")?.to_owned(), t.clone())));
        self.averages = saved.collect();
        Ok(())
    }
}

#[derive(Clone, Copy)]
struct Average<T> {
    keep: T,
    take: T,
}

impl<T: Real> Rule<T, 0> for Average<T> {
    #[inline(always)]
    fn update(self, average: T, x: T, _: [T; 0]) -> (T, [T; 0]) {
        (self.keep * average + self.take * x, [])
    }
}
