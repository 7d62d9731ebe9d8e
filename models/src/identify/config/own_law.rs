//! A law that is not shipped, in the settings of a run.

use std::path::{Path, PathBuf};

use gradreel::Result;

use crate::identify::Config;
use crate::physics::{Law, law_file};

/// The law of a run that brings its own; equal if name and text are.
#[derive(Debug, Clone, Default)]
pub struct OwnLaw(Option<Law>);

impl PartialEq for OwnLaw {
    fn eq(&self, other: &Self) -> bool {
        let key = |own: &Self| own.0.as_ref().map(|law| (law.name().to_owned(), law.text().map(str::to_owned)));
        key(self) == key(other)
    }
}

impl OwnLaw {
    /// The law, if there is one.
    pub fn law(&self) -> Option<&Law> {
        self.0.as_ref()
    }
}

impl Config {
    /// The same settings with a law of one's own. One that was read from a file travels with the run; to go on with a run of
    /// another, [`register`](crate::physics::materials::register) it first.
    ///
    /// ```
    /// use gradreel_models::identify::Config;
    /// use gradreel_models::physics::{Law, WgslLaw};
    ///
    /// let text = "struct Parameters {
    ///     /// Bulk modulus K [Pa], log10, 1e3 to 1e6
    ///     bulk: f32,
    /// }
    /// fn stress(point: Point, p: Parameters) -> mat3x3<f32> {
    ///     return p.bulk * (trace(point.f) - 3.0) * identity();
    /// }";
    /// let config = Config::default().with_law(Law::of(WgslLaw::parse("foam.wgsl", text)?));
    /// assert_eq!(config.law()?.name(), "foam");
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[must_use]
    pub fn with_law(mut self, law: Law) -> Self {
        law.name().clone_into(&mut self.material.name);
        self.material.law = law.text().map(|_| PathBuf::from(law_file(law.name())));
        self.material.own = OwnLaw(Some(law));
        self
    }

    /// Reads the file that `material.law` names, if it names one; a relative path begins at `folder`.
    ///
    /// # Errors
    /// Those of [`Law::read`].
    pub fn read_law(&mut self, folder: &Path) -> Result<()> {
        if let Some(path) = &self.material.law {
            let law = Law::read(folder.join(path))?;
            *self = std::mem::take(self).with_law(law);
        }
        Ok(())
    }
}
