//! The radiance field against vectors of an independent implementation, closed forms and central differences.

mod claimed;
mod dynamics;
mod falling;
#[path = "../../../tests/vectors/find.rs"]
mod find;
mod grids;
mod harness;
mod losses;
mod rendering;
mod seeding;
mod steps;
mod temporal;
