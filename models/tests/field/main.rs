//! The radiance field against vectors of an independent implementation, closed forms and central differences.

mod dynamics;
mod falling;
mod grids;
mod harness;
mod losses;
mod rendering;
mod sowing;
mod steps;
mod temporal;
