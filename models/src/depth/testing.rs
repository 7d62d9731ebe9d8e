//! Solids of closed form for the tests.

use std::f32::consts::PI;

use super::Solid;

/// A box with these half sides, its corners in four colours.
pub(super) fn boxed(half: [f32; 3]) -> Solid {
    let corner = |n: usize| std::array::from_fn(|k| if n >> k & 1 == 1 { half[k] } else { -half[k] });
    let corners: Vec<[f32; 3]> = (0..8).map(corner).collect();
    let quad = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    let faces = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let colours = (0..8u8).map(|n| [60 + 20 * n, 200 - 20 * n, 90]).collect();
    Solid::new(corners, colours, faces.into_iter().flat_map(quad).collect()).unwrap()
}

/// A grey ball around the origin, of so many sectors and half as many bands.
pub(super) fn ball(radius: f32, sectors: usize) -> Solid {
    let bands = sectors / 2;
    let place = |band: usize, sector: usize| {
        let (polar, around) = (PI * band as f32 / bands as f32, 2.0 * PI * sector as f32 / sectors as f32);
        [polar.sin() * around.cos(), polar.cos(), polar.sin() * around.sin()].map(|x| radius * x)
    };
    let corners: Vec<[f32; 3]> = (0..=bands).flat_map(|b| (0..sectors).map(move |s| place(b, s))).collect();
    let at = |band: usize, sector: usize| (band * sectors + sector % sectors) as u32;
    let quads =
        (0..bands).flat_map(|b| (0..sectors).map(move |s| [at(b, s), at(b, s + 1), at(b + 1, s + 1), at(b + 1, s)]));
    let triangles = quads.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let count = corners.len();
    Solid::new(corners, vec![[128; 3]; count], triangles).unwrap()
}
