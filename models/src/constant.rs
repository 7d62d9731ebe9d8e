//! Constants on the tape of a reference variable, in its type and on its device.

use gradreel::{Result, Shape, Tensor, Var};

/// A constant from numbers, in the type and on the device of `beside`.
pub(crate) fn numbers(beside: &Var, values: Vec<f64>, shape: impl Into<Shape>) -> Result<Var> {
    let value = Tensor::from_vec(values, shape).cast(beside.dtype())?.to_device(&beside.device())?;
    Ok(beside.tape().constant(value))
}

/// A constant from points `[n, 3]`, in the type and on the device of `beside`.
pub(crate) fn points(beside: &Var, points: &[[f64; 3]]) -> Result<Var> {
    let value = match beside.dtype() {
        gradreel::DType::F32 => {
            let values: Vec<f32> = points.as_flattened().iter().map(|&x| x as f32).collect();
            Tensor::from_vec(values, [points.len(), 3])
        }
        dtype => Tensor::from_vec(points.as_flattened().to_vec(), [points.len(), 3]).cast(dtype)?,
    };
    Ok(beside.tape().constant(value.to_device(&beside.device())?))
}

/// A constant from indices, on the device of `beside`.
pub(crate) fn indices(beside: &Var, values: Vec<u32>) -> Result<Var> {
    let count = values.len();
    Ok(beside.tape().constant(Tensor::from_vec(values, [count]).to_device(&beside.device())?))
}

/// A constant from a tensor of any type, in the type and on the device of `beside`.
pub(crate) fn tensor(beside: &Var, value: &Tensor) -> Result<Var> {
    Ok(beside.tape().constant(value.cast(beside.dtype())?.to_device(&beside.device())?))
}
