//! The material beside the voxels in one fit: held, it keeps the shape where it is wrong with it.

use gradreel::optim::{Bound as Store, Params};
use gradreel::{DType, Error, ErrorKind, Result, Tape, Tensor};

use crate::identify::{Bound, Config, Free, Unknowns};
use crate::physics::Law;

/// Where the store of a fit has the coordinates of the material `[free parameters]`.
pub(in crate::identify) const UNKNOWNS: &str = "unknowns";

/// What moves the voxels of a fit: unknowns, of which the parameters of the material may be fitted with the voxels.
pub(in crate::identify) struct WithVoxels<'a> {
    /// Where the fit starts.
    pub start: Unknowns,
    law: &'a Law,
    free: Free,
}

impl<'a> WithVoxels<'a> {
    /// From `start`; the material is free if the voxels are `simulated` and the configuration does not hold it.
    ///
    /// # Errors
    /// What the configuration says of a parameter that the law does not have.
    pub fn new(law: &'a Law, start: Unknowns, simulated: bool, config: &Config) -> Result<Self> {
        let fitted = simulated && config.geometry.fit.material_rate > 0.0;
        let free = if fitted { Free::all_but(law, &config.held(law)?, false) } else { Free::NOTHING };
        Ok(Self { start, law, free })
    }

    /// Whether nothing of the material is fitted.
    pub fn is_held(&self) -> bool {
        self.free.list(self.law).is_empty()
    }

    /// Adds the material to the store of a fit that begins.
    ///
    /// # Errors
    /// Never for `f32` and `f64`.
    pub fn begin(&self, params: &mut Params, dtype: DType) -> Result<()> {
        if !self.is_held() {
            let coordinates = self.start.coordinates(self.law, self.free);
            let count = coordinates.len();
            params.set(UNKNOWNS, Tensor::from_vec(coordinates, [count]).cast(dtype)?);
        }
        Ok(())
    }

    /// The unknowns of a store.
    ///
    /// # Errors
    /// [`gradreel::ErrorKind::Input`] for a store that does not hold as many as are free.
    pub fn found(&self, params: &Params) -> Result<Unknowns> {
        if self.is_held() { Ok(self.start.clone()) } else { self.at(params.get(UNKNOWNS)?) }
    }

    fn at(&self, coordinates: &Tensor) -> Result<Unknowns> {
        let count = self.free.list(self.law).len();
        let values = coordinates.to_vec()?;
        let refused = match coordinates.dims() == [count] {
            false => Some(ErrorKind::Input),
            true => values.iter().any(|value| !value.is_finite()).then_some(ErrorKind::NonFinite),
        };
        if let Some(kind) = refused {
            return Err(Error::new(kind, "the material that is fitted with the voxels cannot be used")
                .at(UNKNOWNS)
                .found(format!("{values:?}"))
                .wanted(format!("{count} finite numbers"))
                .fix("hold it (geometry.fit.material_rate = 0), or start again with another --out"));
        }
        Ok(self.start.moved(self.law, self.free, &values))
    }

    /// The unknowns of a store that is on a tape, there and as values.
    ///
    /// # Errors
    /// As [`WithVoxels::found`].
    pub fn bound(&self, store: &Store, tape: &Tape, dtype: DType) -> Result<(Bound, Unknowns)> {
        if self.is_held() {
            return Ok((self.start.constants(tape, dtype)?, self.start.clone()));
        }
        let coordinates = store.get(UNKNOWNS)?;
        let values = self.at(coordinates.value()?)?;
        Ok((self.start.moved_on_tape(self.law, self.free, coordinates)?, values))
    }
}
