// Where points lie in a regular grid. Twin of src/ops/grid.rs (the words) and src/backend/cpu/grid/cell.rs (the rest).

// The numbers of a lookup. Axes hold size, stride in nodes and component of a point; maps hold origin, scale, shift and
// number of the last node: component x is at node number (x - origin) * scale + shift. The slowest axis comes first.
struct Grid {
    len: u32,
    rank: u32,
    // nodes around a point: two to the rank, or one for the nearest
    corners: u32,
    border: u32,
    batch: u32,
    channels: u32,
    nodes: u32,
    count: u32,
    // distance in elements of two nodes and of two channels of the grid, of two points and of two channels of samples
    node_step: u32,
    value_step: u32,
    point_step: u32,
    sample_step: u32,
    axes: array<vec4<u32>, 3>,
    maps: array<vec4<f32>, 3>,
}

// What one coordinate says: number of the lower node (one before the first is -1), weights of both, and their slopes.
struct Hat {
    near: bool,
    base: i32,
    weight: vec2<f32>,
    slope: vec2<f32>,
}

fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

// NaN from a number that is not finite; the bits are built at run time, because a constant NaN is no valid expression.
fn nan_of(x: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(x) | 0x7fc00000u);
}

// `poison` is a component of the point that is not finite, or 0.
fn hat_of(axis: u32, x: f32, poison: f32, nearest: bool, border: bool, map: vec4<f32>) -> Hat {
    var hat: Hat;
    if !is_finite(poison) {
        let nan = nan_of(poison);
        hat.near = true;
        hat.weight = vec2<f32>(nan, select(nan, 0.0, nearest));
        hat.slope = hat.weight;
        return hat;
    }
    var g = (x - map.x) * map.y + map.z;
    var slope = map.y;
    if border {
        if g <= 0.0 {
            g = 0.0;
            slope = 0.0;
        } else if g >= map.w {
            g = map.w;
            slope = 0.0;
        }
    }
    let lower = select(floor(g), round(g), nearest);
    hat.near = lower >= select(-1.0, 0.0, nearest) && lower <= map.w;
    if !hat.near {
        return hat;
    }
    hat.base = i32(lower);
    if nearest {
        hat.weight = vec2<f32>(1.0, 0.0);
        return hat;
    }
    let f = g - lower;
    hat.weight = vec2<f32>(1.0 - f, f);
    hat.slope = vec2<f32>(-slope, slope);
    if lower < 0.0 {
        hat.weight.x = 0.0;
        hat.slope.x = 0.0;
    }
    if lower >= map.w {
        hat.weight.y = 0.0;
        hat.slope.y = 0.0;
    }
    return hat;
}

// On which side of a cell a corner lies along an axis: the slowest axis is the highest bit.
fn side_of(corner: u32, axis: u32, rank: u32) -> u32 {
    return (corner >> (rank - 1u - axis)) & 1u;
}

// The number of the node on that side; its neighbour where there is none (the weight is 0 then).
fn node_of(hat: Hat, side: u32, size: u32) -> u32 {
    return u32(clamp(hat.base + i32(side), 0, i32(size) - 1));
}
