//! Video input: frames, masks and cameras of a clip.
//!
//! A *clip* is a folder with the images of several static cameras and a list of these cameras. [`Clip::open`] reads
//! it into memory: one [`Camera`] per view and one [`Frame`] per camera and time step, which shows the object alone
//! on white with its coverage `alpha`. [`inspect()`] reports on the same folder even if it is incomplete.
//!
//! # Layouts
//!
//! The layout is recognised by the files present ([`Format`]):
//!
//! | layout | recognised by | cameras | frames | times |
//! |---|---|---|---|---|
//! | PAC-NeRF | `all_data.json` | `c2w`, OpenGL axes, y up, metres | `data/r_{camera}_{frame}.png` | in seconds |
//! | Spring-Gaus, synthetic | `camera.json` | `c2w`, OpenGL axes, y up, metres | `{camera}/{frame}.png` | 0.03 s apart |
//! | Spring-Gaus, real | `dynamic/cameras_calib.json` | `rvecs`, `tvecs`, OpenCV axes, z down, metres | as listed in `dynamic/sequences/{object}/{number}.json`, whose path is the clip's | 120 per second |
//! | NeRF, D-NeRF | `transforms.json`, `transforms_{train,val,test}.json` | `transform_matrix`, OpenGL axes, z up | as listed | `time` in seconds or normalised |
//! | COLMAP | `sparse/0/cameras.txt` and `images.txt` (also in `sparse`, `colmap/sparse/0`) | OpenCV axes, up as the cameras are held | a folder per camera, named as its image or that image's folder, in `frames`, `images` or the clip's folder | 24 per second |
//!
//! The optional file `clip.toml` in the clip's folder supplies what the layout leaves open. Every key is optional;
//! defaults are assumed for missing keys and reported in [`Clip::assumptions`]:
//!
//! ```toml
//! layout = "colmap"         # if the folder matches several: pac_nerf, spring_gaus, real_capture, transforms, colmap
//! up = "z"                  # x, y, z, -x, -y, -z or a vector, in the layout's coordinates
//! metres_per_unit = 0.25    # length of the layout's unit [m]
//! origin = [0.1, 0.0, 2.0]  # the point that becomes the origin, in the layout's coordinates, for example on the ground
//! frames_per_s = 60.0       # frame rate [1/s], in place of the layout's times
//! imagined = [1, 2, 3]      # cameras whose images were synthesized from those of the others
//! # duration_s = 0.5        # or: duration of normalised times 0…1, or from the first frame to the last [s]
//! ```
//!
//! Lens distortion and paths that lead out of the folder are errors. Images are PNG or JPEG. In all layouts except
//! PAC-NeRF's the object is separated from the background by the images' alpha channel or by masks, white on the
//! object, stored under `masks/` with the path of the image (`mask_path` in a `transforms.json`).
//!
//! # Films
//!
//! A GIF, a video file or a folder of numbered pictures without a camera list is a [`Film`] of one uncalibrated
//! camera; [`crate::monocular`] turns it into a clip. A first pass over small pictures surveys the whole film: the
//! camera's motion is taken out, moving components are tracked, and those that fly on a downward parabola in time are
//! the object; where two parabolas meet, it hits. The second pass reads the frames of one fall, its contact and what
//! follows, at the size that the object needs. Each frame has its own time; phone pictures are rotated by their Exif
//! orientation. In a window around its track the object is separated by given masks, a given matting network
//! ([`MattingSettings`]), the pictures' alpha channel, a given background, a plain background, or the background that
//! is seen while the object is elsewhere. [`Story`] has what was understood.
//!
//! # PAC-NeRF
//!
//! `all_data.json` lists one entry per image (time, camera-to-world matrix, intrinsics).
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
//! The foreground source of a camera is the first available of: `a_` masks, `m_` masks, transparent pixels in its
//! own images, a background plate ([`Foreground`]).
//!
//! World: metres, y up. Cameras follow OpenGL: x right, y up, looking along −z. Pixel coordinates: `u` grows to the
//! right, `v` downwards, and the centre of the first pixel is `(0.5, 0.5)`.

mod bounces;
mod camera;
mod clip;
mod film;
mod foreground;
mod image;
mod inspect;
mod layout;
mod mask;
mod matrix;
mod matte;
mod orientation;
pub(crate) mod parabola;
mod plausible;
mod samples;
mod scale;
mod select;
mod shutter;
mod story;

pub use bounces::{Bounces, FreeFlight, Hit, Known};
pub use camera::Camera;
pub(crate) use clip::WARNING;
pub use clip::{Around, Clip, Flight, Frame, OpenOptions, PitchSpread, PixelRect};
pub use film::{ContactModel, Film, FilmSettings, MattingSettings};
pub(crate) use film::{EXPOSURES, ROW_TIMES};
pub use foreground::Foreground;
pub(crate) use image::Image;
pub use inspect::{CameraInventory, Inventory, inspect, inspect_and_open};
pub use layout::Format;
pub(crate) use matte::from_white;
pub use shutter::Shutter;
pub(crate) use story::WITHIN;
pub use story::{Curve, Doing, Phase, Sight, Snapshot, Story};
