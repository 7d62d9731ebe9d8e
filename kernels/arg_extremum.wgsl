// Where the largest or smallest element behind each result is, counted along the dropped axes: the first one on a tie,
// the first NaN if there is one. `rows` gives each result to one invocation, `tree` to one workgroup; `find` looks for
// extrema that are known, in one window of the operand after the other.
#import "shared/linear.wgsl"
#import "shared/is_nan.wgsl"

// Twin of ArgExtremum::forward_gpu. Axes hold size and step; the outermost comes first.
struct Layout {
    // number of results, and of elements behind each
    results: u32,
    count: u32,
    kept_rank: u32,
    dropped_rank: u32,
    // 1: the largest, 0: the smallest
    largest: u32,
    // in windows: the numbers of the first result and of the first element of x, and 1 where no window came before
    y_first: u32,
    x_first: u32,
    fresh: u32,
    kept: array<vec4<u32>, 8>,
    dropped: array<vec4<u32>, 8>,
}

@group(0) @binding(0) var<uniform> sizes: Layout;
@group(0) @binding(1) var<storage, read_write> y: array<u32>;
@group(0) @binding(2) var<storage, read> x: array<f32>;

// Where the elements behind one result begin.
fn base_of(result: u32) -> u32 {
    var rest = result;
    var place = 0u;
    for (var axis = sizes.kept_rank; axis > 0u; axis--) {
        let extent = sizes.kept[axis - 1u];
        place += rest % extent.x * extent.y;
        rest /= extent.x;
    }
    return place;
}

// Where the element behind a result with this number is.
fn place_of(base: u32, number: u32) -> u32 {
    var rest = number;
    var place = base;
    for (var axis = sizes.dropped_rank; axis > 0u; axis--) {
        let extent = sizes.dropped[axis - 1u];
        place += rest % extent.x * extent.y;
        rest /= extent.x;
    }
    return place;
}

// That element, so turned that the largest is sought.
fn element(base: u32, number: u32) -> f32 {
    let value = x[place_of(base, number)];
    return select(-value, value, sizes.largest == 1u);
}

// Whether an element comes before the best so far.
fn better(value: f32, number: u32, best: f32, place: u32) -> bool {
    let first = number < place;
    if scalar_is_nan(value) || scalar_is_nan(best) {
        return scalar_is_nan(value) && (first || !scalar_is_nan(best));
    }
    return value > best || (value == best && first);
}

@compute @workgroup_size(WORKGROUP)
fn rows(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i >= sizes.results {
        return;
    }
    let base = base_of(i);
    var best = element(base, 0u);
    var place = 0u;
    for (var number = 1u; number < sizes.count; number++) {
        let value = element(base, number);
        if better(value, number, best, place) {
            best = value;
            place = number;
        }
    }
    y[i] = place;
}

var<workgroup> values: array<f32, WORKGROUP>;
var<workgroup> places: array<u32, WORKGROUP>;

@compute @workgroup_size(WORKGROUP)
fn tree(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups);
    if i >= sizes.results {
        return;
    }
    let base = base_of(i);
    // an invocation without elements repeats the last one
    var place = min(local, sizes.count - 1u);
    var best = element(base, place);
    for (var number = local + WORKGROUP; number < sizes.count; number += WORKGROUP) {
        let value = element(base, number);
        if better(value, number, best, place) {
            best = value;
            place = number;
        }
    }
    values[local] = best;
    places[local] = place;
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half && better(values[local + half], places[local + half], values[local], places[local]) {
            values[local] = values[local + half];
            places[local] = places[local + half];
        }
    }
    if local == 0u {
        y[i] = places[0];
    }
}

@group(0) @binding(3) var<storage, read> best: array<f32>;

@compute @workgroup_size(WORKGROUP)
fn find(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i >= sizes.results {
        return;
    }
    // places in front of the window wrap around to large numbers
    let base = base_of(sizes.y_first + i) - sizes.x_first;
    let sought = best[i];
    var first = 0xffffffffu;
    if sizes.fresh == 0u {
        first = y[i];
    }
    for (var number = 0u; number < min(sizes.count, first); number++) {
        let place = place_of(base, number);
        if place < arrayLength(&x) {
            let value = x[place];
            if value == sought || (scalar_is_nan(value) && scalar_is_nan(sought)) {
                first = number;
            }
        }
    }
    y[i] = first;
}
