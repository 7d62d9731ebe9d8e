//! Video: frames, masks and cameras of a clip.
//!
//! A *clip* is a folder in the layout of the PAC-NeRF data set: `all_data.json` lists one entry per image (time,
//! camera-to-world matrix, intrinsics) and `data/r_{camera}_{frame}.png` holds the images. [`Clip::open`] reads it into
//! memory: one [`Camera`] per view, and per camera and frame a [`Frame`], the object alone on white with its coverage
//! `alpha`. [`inspect()`] looks at the same folder without insisting that it is complete.
//!
//! | file | meaning |
//! |---|---|
//! | `all_data.json` | list of `{file_path, time, c2w, intrinsic}` |
//! | `data/r_{c}_{f}.png` | camera `c`, frame `f ≥ 0` |
//! | `data/r_{c}_-1.png` | background plate: the same view without the object |
//! | `data/r_{c}_-2.png` | pixels to leave out of every frame of that camera: alpha above 50/255 |
//! | `data/a_{c}_{f}.png` | given mask: the object with its alpha |
//! | `data/m_{c}_{f}.png` | given mask: the object on white |
//!
//! Where the object is, a camera says by the first of these that it has: `a_`, `m_`, transparent pixels of its own
//! images, a background plate ([`Foreground`]).
//!
//! World: metres, y up. Cameras follow OpenGL: x right, y up, looking along −z; `u` grows to the right and `v` downwards,
//! and the centre of the first pixel is `(0.5, 0.5)`.

mod camera;
mod clip;
mod foreground;
mod image;
mod inspect;
mod layout;
mod matrix;
mod matte;
mod scale;
mod select;

pub use camera::Camera;
pub use clip::{Clip, Frame, OpenOptions, PixelRect};
pub use foreground::Foreground;
pub(crate) use image::Image;
pub use inspect::{CameraInventory, Inventory, inspect};
pub(crate) use matte::from_white;
