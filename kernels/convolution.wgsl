// Convolutions of one to three dimensions as products of matrices that are never made: forward, its transpose (an image
// from a result) and its weight (from image and result). Axes that are not there have size and step 1.
//
// As in matmul.wgsl, a workgroup makes a tile of TILE x TILE elements: slabs of both matrices of depth DEPTH go through
// workgroup memory, and each of the 16 x 16 invocations keeps a block of 4 x 4 in registers. What differs between the
// three is where the elements of the slabs are found.
#import "shared/linear.wgsl"

// The host reads it from here.
const TILE: u32 = 64u;
const DEPTH: u32 = 16u;

// Twin of Geometry in src/ops/convolution/geometry.rs.
struct Sizes {
    batch: u32,
    groups: u32,
    // channels of one group, of the image and of the result
    inputs: u32,
    outputs: u32,
    // places along each axis; the last word says whether there is a bias
    image: vec4<u32>,
    result: vec4<u32>,
    kernel: vec4<u32>,
    stride: vec4<u32>,
    padding: vec4<u32>,
    dilation: vec4<u32>,
    // a transposed convolution makes the pixels first + i * stride, i below count, with every tap_step-th tap
    first: vec4<u32>,
    count: vec4<u32>,
    tap_first: vec4<u32>,
    tap_step: vec4<u32>,
    tap_count: vec4<u32>,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;
@group(0) @binding(2) var<storage, read> x: array<f32>;
@group(0) @binding(3) var<storage, read> w: array<f32>;
@group(0) @binding(4) var<storage, read> bias: array<f32>;

// Both as [DEPTH, TILE].
var<workgroup> a_slab: array<f32, TILE * DEPTH>;
var<workgroup> b_slab: array<f32, TILE * DEPTH>;
var<private> block: array<vec4<f32>, 4>;

fn volume(size: vec4<u32>) -> u32 {
    return size.x * size.y * size.z;
}

fn place(number: u32, size: vec4<u32>) -> vec3<u32> {
    return vec3(number / (size.y * size.z), number / size.z % size.y, number % size.z);
}

fn number(place: vec3<u32>, size: vec4<u32>) -> u32 {
    return (place.x * size.y + place.y) * size.z + place.z;
}

// Where the tap `tap` of the result at `at` lies in the image. In front of the image it wraps around to large numbers.
fn touched(at: vec3<u32>, tap: vec3<u32>) -> vec3<u32> {
    return at * sizes.stride.xyz + tap * sizes.dilation.xyz - sizes.padding.xyz;
}

fn inside(at: vec3<u32>, size: vec4<u32>) -> bool {
    return all(at < size.xyz);
}

// Which tile of which group this workgroup makes: group, first row, first column.
fn tile_of(number: u32, rows: u32, columns: u32) -> vec3<u32> {
    let across = (columns + TILE - 1u) / TILE;
    let down = (rows + TILE - 1u) / TILE;
    return vec3(number / (across * down), number / across % down * TILE, number % across * TILE);
}

fn multiply(local: u32) {
    for (var z = 0u; z < DEPTH; z++) {
        let at_a = z * TILE + local / 16u * 4u;
        let at_b = z * TILE + local % 16u * 4u;
        let right = vec4(b_slab[at_b], b_slab[at_b + 1u], b_slab[at_b + 2u], b_slab[at_b + 3u]);
        block[0] += a_slab[at_a] * right;
        block[1] += a_slab[at_a + 1u] * right;
        block[2] += a_slab[at_a + 2u] * right;
        block[3] += a_slab[at_a + 3u] * right;
    }
}

// result[group · outputs + row, column] = sum over (input, tap) of weight · image; columns are (batch, place of the result).
@compute @workgroup_size(WORKGROUP)
fn forward(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let taps = volume(sizes.kernel);
    let places = volume(sizes.result);
    let pixels = volume(sizes.image);
    let columns = sizes.batch * places;
    let tile = tile_of(linear_group(group, groups), sizes.outputs, columns);
    if tile.x >= sizes.groups {
        return;
    }
    let depths = sizes.inputs * taps;
    for (var depth = 0u; depth < depths; depth += DEPTH) {
        for (var turn = 0u; turn < TILE * DEPTH / WORKGROUP; turn++) {
            let slot = turn * WORKGROUP + local;
            // neighbouring invocations read neighbouring weights …
            let row = tile.y + slot / DEPTH;
            let a_depth = depth + slot % DEPTH;
            var a_value = 0.0;
            if row < sizes.outputs && a_depth < depths {
                a_value = w[(tile.x * sizes.outputs + row) * depths + a_depth];
            }
            a_slab[slot % DEPTH * TILE + slot / DEPTH] = a_value;
            // … and neighbouring pixels
            let column = tile.z + slot % TILE;
            let b_depth = depth + slot / TILE;
            var b_value = 0.0;
            if column < columns && b_depth < depths {
                let at = touched(place(column % places, sizes.result), place(b_depth % taps, sizes.kernel));
                if inside(at, sizes.image) {
                    let channel = (column / places * sizes.groups + tile.x) * sizes.inputs + b_depth / taps;
                    b_value = x[channel * pixels + number(at, sizes.image)];
                }
            }
            b_slab[slot] = b_value;
        }
        workgroupBarrier();
        multiply(local);
        workgroupBarrier();
    }
    for (var i = 0u; i < 4u; i++) {
        let row = tile.y + local / 16u * 4u + i;
        for (var j = 0u; j < 4u; j++) {
            let column = tile.z + local % 16u * 4u + j;
            if row < sizes.outputs && column < columns {
                let channel = tile.x * sizes.outputs + row;
                var value = block[i][j];
                if sizes.image.w == 1u {
                    value += bias[channel];
                }
                y[(column / places * sizes.groups * sizes.outputs + channel) * places + column % places] = value;
            }
        }
    }
}

// image[group · inputs + row, column] = sum over (output, tap) of weight · result; columns are (batch, pixel of the phase),
// and only the taps of the phase count. Here y is the image and x the result.
@compute @workgroup_size(WORKGROUP)
fn transposed(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let taps = max(volume(sizes.tap_count), 1u);
    let kernel = volume(sizes.kernel);
    let visited = volume(sizes.count);
    let places = volume(sizes.result);
    let pixels = volume(sizes.image);
    let columns = sizes.batch * visited;
    let tile = tile_of(linear_group(group, groups), sizes.inputs, columns);
    if tile.x >= sizes.groups {
        return;
    }
    let depths = sizes.outputs * volume(sizes.tap_count);
    for (var depth = 0u; depth < depths; depth += DEPTH) {
        for (var turn = 0u; turn < TILE * DEPTH / WORKGROUP; turn++) {
            let slot = turn * WORKGROUP + local;
            let row = tile.y + slot / DEPTH;
            let a_depth = depth + slot % DEPTH;
            var a_value = 0.0;
            if row < sizes.inputs && a_depth < depths {
                let output = tile.x * sizes.outputs + a_depth / taps;
                let tap = sizes.tap_first.xyz + place(a_depth % taps, sizes.tap_count) * sizes.tap_step.xyz;
                a_value = w[(output * sizes.inputs + row) * kernel + number(tap, sizes.kernel)];
            }
            a_slab[slot % DEPTH * TILE + slot / DEPTH] = a_value;
            let column = tile.z + slot % TILE;
            let b_depth = depth + slot / TILE;
            var b_value = 0.0;
            if column < columns && b_depth < depths {
                let tap = sizes.tap_first.xyz + place(b_depth % taps, sizes.tap_count) * sizes.tap_step.xyz;
                let pixel = sizes.first.xyz + place(column % visited, sizes.count) * sizes.stride.xyz;
                // a multiple of the stride; in front of the result it is negative
                let reach = vec3<i32>(pixel + sizes.padding.xyz) - vec3<i32>(tap * sizes.dilation.xyz);
                let at = vec3<u32>(reach / vec3<i32>(sizes.stride.xyz));
                if inside(at, sizes.result) {
                    let channel = (column / visited * sizes.groups + tile.x) * sizes.outputs + b_depth / taps;
                    b_value = x[channel * places + number(at, sizes.result)];
                }
            }
            b_slab[slot] = b_value;
        }
        workgroupBarrier();
        multiply(local);
        workgroupBarrier();
    }
    for (var i = 0u; i < 4u; i++) {
        let row = tile.y + local / 16u * 4u + i;
        for (var j = 0u; j < 4u; j++) {
            let column = tile.z + local % 16u * 4u + j;
            if row < sizes.inputs && column < columns {
                let channel = tile.x * sizes.inputs + row;
                var value = block[i][j];
                if sizes.image.w == 1u {
                    value += bias[channel];
                }
                let pixel = sizes.first.xyz + place(column % visited, sizes.count) * sizes.stride.xyz;
                let image = column / visited * sizes.groups * sizes.inputs + channel;
                y[image * pixels + number(pixel, sizes.image)] = value;
            }
        }
    }
}

// weight[group · outputs + row, column] = sum over (batch, place of the result) of result · image; columns are (input, tap).
// Here x is the image and w the result.
@compute @workgroup_size(WORKGROUP)
fn weights(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let taps = volume(sizes.kernel);
    let places = volume(sizes.result);
    let pixels = volume(sizes.image);
    let columns = sizes.inputs * taps;
    let tile = tile_of(linear_group(group, groups), sizes.outputs, columns);
    if tile.x >= sizes.groups {
        return;
    }
    let depths = sizes.batch * places;
    for (var depth = 0u; depth < depths; depth += DEPTH) {
        for (var turn = 0u; turn < TILE * DEPTH / WORKGROUP; turn++) {
            let slot = turn * WORKGROUP + local;
            let depth_here = depth + slot % DEPTH;
            let image = depth_here / places;
            let row = tile.y + slot / DEPTH;
            var a_value = 0.0;
            if row < sizes.outputs && depth_here < depths {
                let channel = (image * sizes.groups + tile.x) * sizes.outputs + row;
                a_value = w[channel * places + depth_here % places];
            }
            a_slab[slot % DEPTH * TILE + slot / DEPTH] = a_value;
            let column = tile.z + slot / DEPTH;
            var b_value = 0.0;
            if column < columns && depth_here < depths {
                let at = touched(place(depth_here % places, sizes.result), place(column % taps, sizes.kernel));
                if inside(at, sizes.image) {
                    let channel = (image * sizes.groups + tile.x) * sizes.inputs + column / taps;
                    b_value = x[channel * pixels + number(at, sizes.image)];
                }
            }
            b_slab[slot % DEPTH * TILE + slot / DEPTH] = b_value;
        }
        workgroupBarrier();
        multiply(local);
        workgroupBarrier();
    }
    for (var i = 0u; i < 4u; i++) {
        let row = tile.y + local / 16u * 4u + i;
        for (var j = 0u; j < 4u; j++) {
            let column = tile.z + local % 16u * 4u + j;
            if row < sizes.outputs && column < columns {
                y[(tile.x * sizes.outputs + row) * columns + column] = block[i][j];
            }
        }
    }
}
