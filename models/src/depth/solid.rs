//! A coloured mesh of which pictures are drawn.

use gradreel::{Error, ErrorKind, Result};

use crate::views::objects::TexturedMesh;

/// A mesh with a colour at each corner. Triangles are drawn from both sides; their winding does not matter.
#[derive(Debug, Clone, PartialEq)]
pub struct Solid {
    corners: Vec<[f32; 3]>,
    colours: Vec<[u8; 3]>,
    triangles: Vec<[u32; 3]>,
    /// Largest distance of a corner from the origin.
    reach: f32,
}

impl Solid {
    /// A mesh of corners, their colours (sRGB) and triangles of corner numbers; +y points up.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a mesh without triangles, with a corner that is not finite, with colours for other than all
    /// corners, with a triangle of corners that it does not have, or without extent.
    ///
    /// ```
    /// use gradreel_models::depth::Solid;
    ///
    /// let corners = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    /// assert!(Solid::new(corners.clone(), vec![[200, 0, 0]; 3], vec![[0, 1, 2]]).is_ok());
    /// assert!(Solid::new(corners, vec![[200, 0, 0]; 3], vec![[0, 1, 3]]).is_err());
    /// ```
    pub fn new(corners: Vec<[f32; 3]>, colours: Vec<[u8; 3]>, triangles: Vec<[u32; 3]>) -> Result<Self> {
        let wrong = |what: &str, found: String, wanted: String| {
            Err(Error::new(ErrorKind::Input, what).found(found).wanted(wanted).fix("repair or leave out the mesh"))
        };
        if triangles.is_empty() {
            return wrong("a mesh has no triangles", "none".into(), "at least one".into());
        }
        if colours.len() != corners.len() {
            return wrong(
                "a mesh has not a colour for each corner",
                colours.len().to_string(),
                format!("{} colours", corners.len()),
            );
        }
        let outside = |t: &&[u32; 3]| t.iter().any(|&corner| corner as usize >= corners.len());
        if let Some(triangle) = triangles.iter().find(outside) {
            let wanted = format!("numbers below {}", corners.len());
            return wrong("a triangle has a corner that its mesh does not have", format!("{triangle:?}"), wanted);
        }
        let far =
            corners.iter().map(|c| c.iter().map(|x| x * x).sum::<f32>()).fold(0.0, |a: f32, b| a + (b - a).max(0.0));
        let finite = corners.iter().flatten().all(|x| x.is_finite() && x.abs() < 1e15);
        if !finite || far <= 0.0 {
            return wrong(
                "a mesh has no finite extent",
                format!("a reach of {}", far.sqrt()),
                "finite corners apart".into(),
            );
        }
        Ok(Self { corners, colours, triangles, reach: far.sqrt() })
    }

    /// The surface of a textured mesh, with the colours at its corners.
    ///
    /// # Errors
    /// As [`Solid::new`].
    pub(crate) fn of_mesh(mesh: &TexturedMesh) -> Result<Self> {
        let byte = |x: f32| (255.0 * x.clamp(0.0, 1.0)).round() as u8;
        // z is up there, y here
        let corner = |([x, y, z], colour): ([f32; 3], [f32; 3])| ([x, z, -y], colour.map(byte));
        let (corners, colours): (Vec<_>, Vec<_>) = mesh.corners().map(corner).unzip();
        let triangles = (0..corners.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        Self::new(corners, colours, triangles)
    }

    /// Places of the corners.
    pub fn corners(&self) -> &[[f32; 3]] {
        &self.corners
    }

    /// Colours of the corners, sRGB.
    pub fn colours(&self) -> &[[u8; 3]] {
        &self.colours
    }

    /// Corner numbers of the triangles.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Largest distance of a corner from the origin.
    pub fn reach(&self) -> f32 {
        self.reach
    }
}
