//! How the parts are used, and what comes of it.

#[test]
fn a_disc_becomes_a_ball() {
    use crate::field::inflate::half_thickness;
    use crate::video::Frame;
    use ndarray::{Array2, Array3};

    let disc = Array2::from_shape_fn((41, 41), |(y, x)| f32::from((x as f32 - 20.0).hypot(y as f32 - 20.0) < 15.0));
    let frame = Frame { rgb: Array3::ones((41, 41, 3)), weight: Array2::ones((41, 41)), alpha: disc };
    let half = half_thickness(&frame);
    // a ball: the edge runs half a pixel before the first pixel outside
    assert!((half[[20, 20]] - 14.5).abs() < 0.1 && (half[[20, 29]] - (14.5f64 * 14.5 - 9.0 * 9.0).sqrt()).abs() < 0.1);
}

#[test]
fn a_lookup_is_linear_between_the_nodes() -> gradreel::Result<()> {
    use crate::field::DenseGrid;
    use gradreel::{Tape, Tensor};

    let grid = DenseGrid::of_spacing([0.0; 3], [0.2, 0.1, 0.1], 0.1)?;
    assert_eq!(grid.dims, [3, 2, 2]);
    let tape = Tape::new();
    let values = tape.leaf(Tensor::from_vec((0..12).map(f64::from).collect(), [3, 2, 2, 1]));
    let points = tape.constant(Tensor::from_vec(vec![0.05, 0.05, 0.0], [1, 3]));
    assert!((grid.lookup(&values, &points)?.item()? - 3.0).abs() < 1e-12);
    Ok(())
}

#[test]
fn a_pit_has_more_area_than_a_side_and_a_carved_cube_none() -> gradreel::Result<()> {
    use crate::field::Field;
    use gradreel::ops::NodeGrid;
    use gradreel::{Tape, Tensor};

    let node_grid = NodeGrid { origin: [0.0; 3], spacing: 0.01, dims: [5; 3] };
    let faces = Field { node_grid, voxels: (0..125).collect() }.faces();
    let tape = Tape::new();
    let mut opacity = vec![1.0; 125];
    let whole = faces.area(&tape.constant(Tensor::from_vec(opacity.clone(), [125, 1])))?.item()?;
    opacity[12] = 0.0; // the middle of a side
    let pitted = faces.area(&tape.constant(Tensor::from_vec(opacity, [125, 1])))?.item()?;
    assert!((whole - 0.905).abs() < 1e-3 && pitted > 1.02 * whole);
    // what is carved from a whole cube: nothing
    let carved = faces.carved().area(&tape.constant(Tensor::full(1.0, [125, 1], gradreel::DType::F64)))?.item()?;
    assert_eq!(carved, 0.0);
    Ok(())
}

#[test]
fn a_field_is_refined_where_it_is_opaque() -> gradreel::Result<()> {
    use crate::field::{DenseGrid, RadianceField, RadianceSizes};
    use gradreel::{DType, Key};

    let grid = DenseGrid::of_spacing([-0.5, 0.1, -0.5], [0.5, 1.0, 0.5], 0.16)?;
    let mut field = RadianceField::new(grid, 1e-4, RadianceSizes::default());
    let params = field.initialise(Key::new(1), DType::F32)?;
    assert_eq!(params.get("radiance.features")?.dims(), [7, 7, 7, 12]);
    // nothing is there yet, so that the mask of opaque nodes would be empty at a threshold above α = 1e-4
    assert!(field.refined(&params, 1e-2)?.is_none());
    let (params, occupancy) = field.refined(&params, 1e-7)?.unwrap();
    assert_eq!((field.grid.spacing, occupancy.occupied.len()), (0.08, params.get("radiance.density")?.len()));
    Ok(())
}
