//! What the clip tells and what it leaves open: priors, the covariance of what errs together, and the posterior.

pub(crate) mod covariance;
pub(crate) mod discrepancy;
pub(crate) mod error_budget;
pub(super) mod interval;
pub(crate) mod mixture;
pub(crate) mod normal;
pub(crate) mod prior;
pub(crate) mod profile;
