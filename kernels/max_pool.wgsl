// Values at the places where windows of x have their maxima: picked from an image, or put into one.
#import "shared/is_nan.wgsl"
#import "shared/linear.wgsl"

struct Sizes {
    len: u32,
    // places along each axis of image and pooled image, and of a window; absent axes have size 1
    image: vec4<u32>,
    pooled: vec4<u32>,
    kernel: vec4<u32>,
    stride: vec4<u32>,
    padding: vec4<u32>,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;
@group(0) @binding(2) var<storage, read> values: array<f32>;
@group(0) @binding(3) var<storage, read> x: array<f32>;

fn volume(size: vec4<u32>) -> u32 {
    return size.x * size.y * size.z;
}

fn place(number: u32, size: vec4<u32>) -> vec3<u32> {
    return vec3(number / (size.y * size.z), number / size.z % size.y, number % size.z);
}

fn number(place: vec3<u32>, size: vec4<u32>) -> u32 {
    return (place.x * size.y + place.y) * size.z + place.z;
}

// Where the window at `window` of the plane that begins at `start` has its first NaN or else its first maximum.
fn first_maximum(start: u32, window: vec3<u32>) -> u32 {
    let corner = window * sizes.stride.xyz;
    let low = max(corner, sizes.padding.xyz) - sizes.padding.xyz;
    let high = min(corner + sizes.kernel.xyz - sizes.padding.xyz, sizes.image.xyz);
    var found = number(low, sizes.image);
    var best = x[start + found];
    for (var i = low.x; i < high.x; i++) {
        for (var j = low.y; j < high.y; j++) {
            for (var k = low.z; k < high.z; k++) {
                let at = number(vec3(i, j, k), sizes.image);
                let value = x[start + at];
                if (value > best || scalar_is_nan(value)) && !scalar_is_nan(best) {
                    best = value;
                    found = at;
                }
            }
        }
    }
    return found;
}

@compute @workgroup_size(WORKGROUP)
fn pick(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i >= sizes.len {
        return;
    }
    let windows = volume(sizes.pooled);
    let start = i / windows * volume(sizes.image);
    y[i] = values[start + first_maximum(start, place(i % windows, sizes.pooled))];
}

// Each pixel gathers from the windows that hold it: no two invocations write to one place.
@compute @workgroup_size(WORKGROUP)
fn unpool(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i >= sizes.len {
        return;
    }
    let pixels = volume(sizes.image);
    let plane = i / pixels;
    let pixel = i % pixels;
    let reach = place(pixel, sizes.image) + sizes.padding.xyz;
    let low = (max(reach + 1u, sizes.kernel.xyz) - sizes.kernel.xyz + sizes.stride.xyz - 1u) / sizes.stride.xyz;
    let high = min(reach / sizes.stride.xyz + 1u, sizes.pooled.xyz);
    var total = 0.0;
    for (var d = low.x; d < high.x; d++) {
        for (var h = low.y; h < high.y; h++) {
            for (var w = low.z; w < high.z; w++) {
                let window = vec3(d, h, w);
                if first_maximum(plane * pixels, window) == pixel {
                    total += values[plane * volume(sizes.pooled) + number(window, sizes.pooled)];
                }
            }
        }
    }
    y[i] = total;
}
