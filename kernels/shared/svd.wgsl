// F = U diag(sigma) Vᵀ of a matrix given row by row: U and V are rotations, |sigma| descends, the last has the sign of
// the determinant. One-sided Jacobi, the twin of src/scalar/svd.rs.
struct scalar_svd_out {
    u: mat3x3<f32>,
    sigma: vec3<f32>,
    v: mat3x3<f32>,
}

// Makes columns p and q of b orthogonal and turns those of v along; whether there was something to do.
fn scalar_svd_rotate(b: ptr<function, mat3x3<f32>>, v: ptr<function, mat3x3<f32>>, p: u32, q: u32) -> bool {
    let x = (*b)[p];
    let y = (*b)[q];
    let pp = dot(x, x);
    let qq = dot(y, y);
    let pq = dot(x, y);
    // 16 ε² relative to the lengths of the columns, ε⁵ absolute
    if !(pq * pq > 2.27373675e-13f * (pp * qq) + 2.4e-35f) {
        return false;
    }
    let d = qq - pp;
    let per_r = 1f / sqrt(d * d + 4f * pq * pq);
    let cos_square = 0.5f + 0.5f * abs(d) * per_r;
    let c = sqrt(cos_square);
    let s = select(pq, -pq, d < 0f) * per_r / c;
    (*b)[p] = c * x - s * y;
    (*b)[q] = s * x + c * y;
    let z = (*v)[p];
    let w = (*v)[q];
    (*v)[p] = c * z - s * w;
    (*v)[q] = s * z + c * w;
    return true;
}

// Puts the longer of two columns first.
fn scalar_svd_sort(b: ptr<function, mat3x3<f32>>, v: ptr<function, mat3x3<f32>>, p: u32, q: u32) {
    let x = (*b)[p];
    let y = (*b)[q];
    if dot(x, x) < dot(y, y) {
        (*b)[p] = y;
        (*b)[q] = -x;
        let z = (*v)[p];
        (*v)[p] = (*v)[q];
        (*v)[q] = -z;
    }
}

fn scalar_svd(
    f00: f32, f01: f32, f02: f32, f10: f32, f11: f32, f12: f32, f20: f32, f21: f32, f22: f32,
) -> scalar_svd_out {
    var b = mat3x3<f32>(f00, f10, f20, f01, f11, f21, f02, f12, f22);
    let largest = max(max(abs(b[0]), abs(b[1])), abs(b[2]));
    let size = max(max(largest.x, largest.y), largest.z);
    var scale = 1f;
    if size > 0f && !(size > 1e-3f && size < 1e3f) {
        scale = size;
    }
    b = b * (1f / scale);
    var v = mat3x3<f32>(1f, 0f, 0f, 0f, 1f, 0f, 0f, 0f, 1f);
    for (var sweep = 0u; sweep < 8u; sweep++) {
        let first = scalar_svd_rotate(&b, &v, 0u, 1u);
        let second = scalar_svd_rotate(&b, &v, 0u, 2u);
        let third = scalar_svd_rotate(&b, &v, 1u, 2u);
        if !(first || second || third) {
            break;
        }
    }
    scalar_svd_sort(&b, &v, 0u, 1u);
    scalar_svd_sort(&b, &v, 1u, 2u);
    scalar_svd_sort(&b, &v, 0u, 1u);
    let square = dot(b[0], b[0]);
    var u0 = vec3<f32>(1f, 0f, 0f);
    if square > 2.4e-35f {
        u0 = b[0] * (1f / sqrt(square));
    }
    var u1 = b[1] - dot(u0, b[1]) * u0;
    if !(dot(u1, u1) > 0.25f * dot(b[1], b[1]) + 2.4e-35f) {
        u1 = select(vec3<f32>(0f, u0.z, -u0.y), vec3<f32>(-u0.z, 0f, u0.x), abs(u0.y) < abs(u0.x));
    }
    u1 = u1 * (1f / sqrt(dot(u1, u1)));
    let u2 = cross(u0, u1);
    let sigma = vec3<f32>(dot(u0, b[0]), dot(u1, b[1]), dot(u2, b[2])) * scale;
    return scalar_svd_out(mat3x3<f32>(u0, u1, u2), sigma, v);
}
