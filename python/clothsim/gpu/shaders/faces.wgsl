// Offset "face": whole triangles are kept out of spheres, as large as they are now (cpp/simulation/face_pass.hpp is the
// same on the CPU and says what is done to a triangle that touches; the names are the same).
//
// One workgroup a member, after `settle`. Triangles share corners, so they are answered color by color, cells of one
// color lying `apart` of each other: no two triangles of a color share a corner, nor a spring between corners whose
// energy one of them looks at. So each invocation writes only what no other reads, no atomic operation on a number is
// needed, and the result is that of one invocation going through the colors in turn, which is the core's order.
//
// Before the colors are gone through, all triangles are looked at once without moving any; most sweeps end there. Cells
// that may touch at all have been found by a dispatch of the whole grid, `find_faces`, as a box of rows and columns.
//
// Of the fourth stage's buffers, stage_b and accelerations hold where every point was before the step, stage_a a
// direction for each of a cell's triangles along which it lies beyond the sphere, 0 for a cell that cannot touch.
const face_tolerance = wide(2e-7);
const apart = 4u;
const lanes = 256u;
const nowhere = 0xffffffffu;

// What a sweep does, in this order, and how many times at most.
const bouncing = 0u;
const lifting = 1u;
const spreading = 2u;
const telling = 3u;

alias Triangle = vec3<u32>;  // its corners, as places in the cloth

var<workgroup> votes: atomic<u32>;
var<workgroup> outcome: u32;
var<workgroup> found_box: vec4<u32>;
var<workgroup> group_box: array<atomic<u32>, 4>;

// The cells that may touch: first row and column, last row and column.
var<private> cells_box: vec4<u32>;
var<private> member_of_pass: u32;
var<private> lane: u32;

fn is_chain() -> bool {
    return constants.rows == 1u || constants.columns == 1u;
}

// Rows and columns of cells; the links of a chain are one row of them.
fn cell_counts() -> vec2<u32> {
    if (is_chain()) {
        return vec2<u32>(1u, points() - 1u);
    }
    return vec2<u32>(constants.rows - 1u, constants.columns - 1u);
}

fn cell_index(cell: vec2<u32>) -> u32 {
    return cell.x * constants.columns * u32(!is_chain()) + cell.y;
}

fn triangle_of(cell: vec2<u32>, kind: u32) -> Triangle {
    let i = cell_index(cell);
    if (is_chain()) {
        return Triangle(i, i + 1u, i + 1u);
    }
    let below = i + constants.columns;
    if (kind == 0u) {
        return Triangle(i, i + 1u, below);
    }
    return Triangle(i + 1u, below + 1u, below);
}

fn base() -> u32 {
    return member_of_pass * 6u * points();
}

fn start_of(s: Swept, i: u32) -> vec3<wide> {
    return before_of(base() + i).position - s.start;
}

fn end_of(s: Swept, i: u32) -> vec3<wide> {
    return now_of(base() + i, 0u) - s.finish;
}

fn starts(s: Swept, t: Triangle) -> Corners {
    return Corners(start_of(s, t.x), start_of(s, t.y), start_of(s, t.z));
}

fn ends(s: Swept, t: Triangle) -> Corners {
    return Corners(end_of(s, t.x), end_of(s, t.y), end_of(s, t.z));
}

fn is_held(i: u32) -> bool {
    return pinned && parameters[member_of_pass * constants.parameter_stride + first_weight + i] == real(0.0);
}

fn owner_of(i: u32) -> Owner {
    return Owner(member_of_pass, i / constants.columns, i % constants.columns, base() + i);
}

fn tolerance_of(s: Swept) -> wide {
    return s.slop + wide_product(face_tolerance, s.radius);
}

fn note_pinned(i: u32) {
    atomicMin(&results[1u + constants.members + member_of_pass], i);
}

const no_corner = 0xffffffffu;

fn pinned_corner(t: Triangle) -> u32 {
    for (var k = 0u; k < 3u; k++) {
        if (is_held(t[k])) {
            return t[k];
        }
    }
    return no_corner;
}

fn note_shut_in(i: u32) {
    atomicMin(&results[1u + 2u * constants.members + member_of_pass], i);
}

// Behind the points left over: the box of a member, then for every point how far it was pushed out of where it started
// inside, this step [m], as three float32 whose sum is the float64.
fn faces_place(member: u32) -> u32 {
    return flags_of(constants.members) + member * (4u + 3u * points());
}

fn pushed_part(i: u32, part: u32) -> u32 {
    return faces_place(member_of_pass) + 4u + 3u * i + part;
}

fn pushed_of(i: u32) -> wide {
    var sum = zero;
    for (var part = 0u; part < 3u; part++) {
        sum += wide(bitcast<f32>(atomicLoad(&results[pushed_part(i, part)])));
    }
    return sum;
}

fn set_pushed(i: u32, value: wide) {
    var rest = value;
    for (var part = 0u; part < 3u; part++) {
        let rounded = f32(rest);
        atomicStore(&results[pushed_part(i, part)], bitcast<u32>(rounded));
        rest -= wide(rounded);
    }
}

// Which cells may touch -------------------------------------------------------------------------------------------

struct Extent {
    low: vec3<wide>,
    high: vec3<wide>,
}

fn with_point(e: Extent, s: Swept, i: u32) -> Extent {
    let p0 = start_of(s, i);
    let p1 = end_of(s, i);
    return Extent(min(e.low, min(p0, p1)), max(e.high, max(p0, p1)));
}

// Whether, over the step, the corners of a cell are not all on one side of the sphere's box.
fn cell_may_touch(s: Swept, cell: vec2<u32>) -> bool {
    let upper = triangle_of(cell, 0u);
    let first = end_of(s, upper.x);
    var e = with_point(Extent(first, first), s, upper.x);
    e = with_point(e, s, upper.y);
    if (!is_chain()) {
        e = with_point(e, s, upper.z);
        e = with_point(e, s, upper.z + 1u);
    }
    let reach = s.radius + wide(8.0) * tolerance_of(s);
    return all(e.low < vec3<wide>(reach)) && all(e.high > vec3<wide>(-reach));
}

// The box of all cells that may touch, of every member.
@compute @workgroup_size(16, 16, 1)
fn find_faces(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    if (index < 4u) {
        atomicStore(&group_box[index], nowhere);
    }
    workgroupBarrier();
    member_of_pass = id.z;
    var cell = vec2<u32>(id.y, id.x);
    if (is_chain()) {
        cell = vec2<u32>(0u, id.y + id.x);
    }
    if (inside(id) && all(cell < cell_counts())) {
        var near = false;
        for (var k = 0u; k < face_spheres; k++) {
            near = near || cell_may_touch(face_sphere(id.z, k), cell);
        }
        if (near) {
            atomicMin(&group_box[0], cell.x);
            atomicMin(&group_box[1], cell.y);
            atomicMin(&group_box[2], ~cell.x);
            atomicMin(&group_box[3], ~cell.y);
        }
    }
    workgroupBarrier();
    if (index < 4u) {
        let least = atomicLoad(&group_box[index]);
        if (least != nowhere) {
            atomicMin(&results[faces_place(id.z) + index], least);
        }
    }
}

// Whether a cell of the box may touch, noted in stage_a with a first guess of the directions.
fn find_candidates(s: Swept) {
    let size = cells_box.zw - cells_box.xy + 1u;
    for (var k = lane; k < size.x * size.y; k += lanes) {
        let cell = cells_box.xy + vec2<u32>(k / size.y, k % size.y);
        let near = cell_may_touch(s, cell);
        for (var kind = 0u; kind < 2u; kind++) {
            var guess = vec3<wide>();
            if (near) {
                let c = ends(s, triangle_of(cell, kind));
                let middle = c.a + c.b + c.c;
                guess = direction(middle, wide_length(middle));
            }
            set_plane(cell, kind, guess);
        }
    }
    storageBarrier();
}

fn plane_place(cell: vec2<u32>, kind: u32) -> u32 {
    return base() + cell_index(cell) + 3u * kind * points();
}

fn set_plane(cell: vec2<u32>, kind: u32, normal: vec3<wide>) {
    let at = plane_place(cell, kind);
    let n = points();
    stage_a[at] = real(normal.x);
    stage_a[at + n] = real(normal.y);
    stage_a[at + 2u * n] = real(normal.z);
}

fn plane_of(cell: vec2<u32>, kind: u32) -> vec3<wide> {
    let at = plane_place(cell, kind);
    let n = points();
    return vec3<wide>(vec3<real>(stage_a[at], stage_a[at + n], stage_a[at + 2u * n]));
}

// A triangle beyond the plane all through the step needs no further look.
fn separated(s: Swept, p0: Corners, p1: Corners, n: vec3<wide>) -> bool {
    let first = min(wide_inner(n, p0.a), min(wide_inner(n, p0.b), wide_inner(n, p0.c)));
    let last = min(wide_inner(n, p1.a), min(wide_inner(n, p1.b), wide_inner(n, p1.c)));
    return min(first, last) > s.radius + wide(1.5) * tolerance_of(s);
}

// What is done to a triangle that touches --------------------------------------------------------------------------

// How the corners share what happens at a place of their triangle.
struct Share {
    weight: vec3<wide>,  // of the place
    part: vec3<wide>,    // displacement of a corner for one of the place
    mobility: wide,      // sum of w^2 / m over free corners [1/kg]
}

fn share_of(t: Triangle, foot: Foot) -> Share {
    var h = Share(foot.weight, vec3<wide>(), zero);
    if (t.y == t.z) {
        h.weight = vec3<wide>(h.weight.x, h.weight.y + h.weight.z, zero);
    }
    for (var k = 0u; k < 3u; k++) {
        if (!is_held(t[k])) {
            h.mobility += wide_product(h.weight[k], h.weight[k]) / mass_of(owner_of(t[k]));
        }
    }
    if (h.mobility <= zero) {
        return h;
    }
    for (var k = 0u; k < 3u; k++) {
        if (!is_held(t[k])) {
            h.part[k] = h.weight[k] / mass_of(owner_of(t[k])) / h.mobility;
        }
    }
    return h;
}

fn motion_of(i: u32) -> Motion {
    return Motion(now_of(base() + i, 0u), now_of(base() + i, 3u));
}

// Moves and turns the corners. Whether that changes any number of the state.
fn apply(t: Triangle, h: Share, displacement: vec3<wide>, velocity: vec3<wide>) -> bool {
    var changed = false;
    for (var k = 0u; k < 3u; k++) {
        if (h.part[k] != zero) {
            let body = motion_of(t[k]);
            set_now(base() + t[k], Motion(
                body.position + wide_scaled(h.part[k], displacement),
                body.velocity + wide_scaled(h.part[k], velocity)));
            let after = motion_of(t[k]);
            changed = changed || any(after.position != body.position) || any(after.velocity != body.velocity);
        }
    }
    return changed;
}

// As `apply` of a displacement, and what it does to the corners' potential energy [J].
fn work_of(t: Triangle, h: Share, displacement: vec3<wide>) -> wide {
    var work = zero;
    for (var k = 0u; k < 3u; k++) {
        if (h.part[k] != zero) {
            let owner = owner_of(t[k]);
            let body = motion_of(t[k]);
            let moved = body.position + wide_scaled(h.part[k], displacement);
            work += potential(owner, moved) - potential(owner, body.position);
            set_now(owner.at, Motion(moved, body.velocity));
        }
    }
    return work;
}

// Velocity of the place at which a triangle touches, relative to the sphere.
fn place_velocity(s: Swept, t: Triangle, h: Share) -> vec3<wide> {
    var velocity = -s.velocity;
    for (var k = 0u; k < 3u; k++) {
        velocity += wide_scaled(h.weight[k], now_of(base() + t[k], 3u));
    }
    return velocity;
}

// The contact at the time at which it happens. Whether there is one; nothing is moved unless `doing`.
fn bounce(s: Swept, t: Triangle, p0: Corners, p1: Corners, touch: TriangleTouch, doing: bool) -> bool {
    let tolerance = tolerance_of(s);
    let h = share_of(t, touch.foot);
    if (h.mobility <= zero) {
        note_pinned(pinned_corner(t));
        return false;
    }
    let n = touch.normal;
    let way = (wide_scaled(h.weight.x, p1.a - p0.a) + wide_scaled(h.weight.y, p1.b - p0.b)) +
        wide_scaled(h.weight.z, p1.c - p0.c);
    let velocity = place_velocity(s, t, h);
    var gain = vec3<wide>();
    for (var k = 0u; k < 3u; k++) {
        gain += wide_scaled(h.weight[k], now_of(base() + t[k], 3u) - before_of(base() + t[k]).velocity);
    }
    let rest = one - touch.time;
    let normal_way = min(wide_inner(way, n), zero);
    let depth = wide_product(-rest, normal_way);
    if (!(depth > tolerance / wide(2.0))) {
        return false;
    }
    if (!doing) {
        return true;
    }
    let speed = wide_inner(velocity, n);
    let press = -wide_inner(gain, n) / s.dt;
    let arrival = sqrt(max(wide_product(speed, speed) - wide_product(wide_product(wide(2.0), press), depth), zero));
    var leaving = max(speed, wide_product(s.restitution, arrival));
    if (wide_product(wide_product(wide(2.0), s.restitution), arrival) > wide_product(press, s.dt)) {
        let work = work_of(t, h, wide_scaled(depth, n));
        let twice = wide_product(wide(2.0), h.mobility);
        let arrival2 = max(wide_product(speed, speed) - wide_product(twice, work), zero);
        let leaving2 = wide_product(wide_product(s.restitution, s.restitution), arrival2);
        let height = wide_product(s.restitution, depth);
        let last2 = leaving2 - wide_product(twice, work_of(t, h, wide_scaled(height, n)));
        if (last2 < zero) {
            apply(t, h, wide_scaled(-height, n), vec3<wide>());
            leaving = sqrt(leaving2);
        } else {
            leaving = sqrt(last2);
        }
    } else {
        apply(t, h, wide_scaled(depth, n), vec3<wide>());
    }
    let tangential = velocity - wide_scaled(speed, n);
    let slip = wide_length(tangential);
    var lost = zero;
    if (s.friction > zero) {
        let most = wide_product(s.friction, max(leaving - speed, zero));
        lost = one;
        if (slip > most) {
            lost = most / slip;
        }
    }
    apply(
        t, h, wide_scaled(wide_product(-lost, rest), way - wide_scaled(normal_way, n)),
        wide_scaled(leaving - speed, n) - wide_scaled(lost, tangential));
    return true;
}

// At the end of the step no place of a triangle is inside, however it came there.
fn lift_out(s: Swept, t: Triangle, p0: Corners, began: wide, foot: Foot, doing: bool) -> bool {
    let tolerance = tolerance_of(s);
    let distance = wide_length(foot.at);
    let innermost = s.radius - tolerance;
    let was_inside = began < innermost;
    var aim = s.radius + wide(4.0) * tolerance;
    var limit = s.radius + tolerance;
    if (was_inside) {
        limit = min(s.radius + wide(2.0) * tolerance, began + s.push);
        aim = min(aim, began + s.push);
    }
    if (distance >= limit) {
        return false;
    }
    let h = share_of(t, foot);
    if (h.mobility <= zero) {
        note_pinned(pinned_corner(t));
        return false;
    }
    let n = direction(foot.at, distance);
    let inwards = min(wide_inner(place_velocity(s, t, h), n), zero);
    // Beside a pinned corner a small weight would throw the free one far: in several sweeps instead.
    let longest = max(h.part.x, max(h.part.y, h.part.z));
    var lift = (aim - distance) / max(one, longest / wide(4.0));
    if (was_inside) {  // a corner goes no faster for being shared, nor for having been inside itself
        var pushed = vec3<wide>();
        let depths = vec3<wide>(wide_length(p0.a), wide_length(p0.b), wide_length(p0.c));
        for (var k = 0u; k < 3u; k++) {
            pushed[k] = pushed_of(t[k]);
            if (pushed[k] == zero && depths[k] < innermost) {
                pushed[k] = s.push;
            }
            if (h.part[k] > zero) {
                lift = min(lift, (s.push - pushed[k]) / h.part[k]);
            }
        }
        if (lift <= wide(1e-3) * s.push && inwards == zero) {
            return false;
        }
        lift = max(lift, zero);
        if (doing) {
            for (var k = 0u; k < 3u; k++) {
                if (h.part[k] != zero) {  // of a link, the third corner is the second one
                    set_pushed(t[k], pushed[k] + wide_product(h.part[k], lift));
                }
            }
        }
    }
    // A speed inwards of the size of rounding stays however often it is taken away.
    return !doing || apply(t, h, wide_scaled(lift, n), wide_scaled(-inwards, n));
}

// Where sharing does not come to an end: every corner out to where a triangle of this size is safe.
fn spread_out(s: Swept, t: Triangle, p1: Corners, distance: wide, doing: bool) -> bool {
    let tolerance = tolerance_of(s);
    if (distance >= s.radius + tolerance) {
        return false;
    }
    let reach = s.radius + wide(4.0) * tolerance;
    let circle = smallest_circle(p1);
    let safe = sqrt(wide_product(reach, reach) + wide_product(circle, circle));
    var moved = false;
    for (var k = 0u; k < 3u; k++) {
        let corner = end_of(s, t[k]);
        let away = wide_length(corner);
        if (!is_held(t[k]) && away < safe && away > zero) {
            moved = true;
            if (doing) {
                var body = motion_of(t[k]);
                body.position += wide_scaled(safe / away - one, corner);
                set_now(base() + t[k], body);
            }
        }
    }
    return moved;
}

fn note_left_over(s: Swept, t: Triangle, distance: wide) {
    if (distance >= s.radius) {
        return;
    }
    let held = pinned_corner(t);
    if (held != no_corner) {
        note_pinned(held);
    } else {
        note_shut_in(t.x);
    }
}

// One triangle of a sweep. Whether it is touched or, if `doing`, whether that changed anything; nothing is moved unless
// `doing`. All sweeps come through here, once in the text, as compilers put a function's text wherever it is called.
fn answer_triangle(s: Swept, cell: vec2<u32>, kind: u32, mode: u32, doing: bool) -> bool {
    let plane = plane_of(cell, kind);
    if (all(plane == vec3<wide>())) {
        return false;
    }
    let t = triangle_of(cell, kind);
    let p0 = starts(s, t);
    let p1 = ends(s, t);
    if (mode <= lifting && separated(s, p0, p1, plane)) {
        return false;
    }
    let began = wide_length(nearest_to_origin(p0).at);
    if (mode != lifting && began < s.radius - tolerance_of(s)) {
        return false;  // was inside: lift_out's part
    }
    if (mode == bouncing) {
        let touch = triangle_touch(p0, p1, s.radius, tolerance_of(s));
        set_plane(cell, kind, touch.normal);
        return touch.hit && bounce(s, t, p0, p1, touch, doing);
    }
    let foot = nearest_to_origin(p1);
    if (mode == lifting) {
        return lift_out(s, t, p0, began, foot, doing);
    }
    if (mode == spreading) {
        return spread_out(s, t, p1, wide_length(foot.at), doing);
    }
    note_left_over(s, t, wide_length(foot.at));
    return false;
}

// Sweeps ------------------------------------------------------------------------------------------------------------

// Whether any invocation of the workgroup says so; all storage written before is seen after.
fn agreed(mine: bool) -> bool {
    if (mine) {
        atomicOr(&votes, 1u);
    }
    storageBarrier();
    workgroupBarrier();
    if (lane == 0u) {
        outcome = atomicExchange(&votes, 0u);
    }
    return workgroupUniformLoad(&outcome) != 0u;
}

// What a sweep did. One that leaves the state as it was would be the same for ever, so it ends its mode.
const none_touched = 0u;
const none_changed = 1u;
const some_changed = 2u;

fn kinds() -> u32 {
    return select(2u, 1u, is_chain());
}

// Through all triangles once: a look at all of them, then color by color.
fn sweep(s: Swept, mode: u32) -> u32 {
    let end = cells_box.zw + 1u;
    var changed = false;
    for (var phase = 0u; phase <= kinds() * apart * apart; phase++) {
        var first = cells_box.xy;
        var step = 1u;
        var sides = kinds();  // of a cell, in this phase
        var kind = 0u;
        if (phase > 0u) {
            let color = (phase - 1u) % (apart * apart);
            let wanted = vec2<u32>(color / apart, color % apart);
            first += (wanted + apart - first % apart) % apart;
            step = apart;
            sides = 1u;
            kind = (phase - 1u) / (apart * apart);
        }
        let size = (max(end, first) - first + step - 1u) / step;
        var touched = false;
        for (var k = lane; k < sides * size.x * size.y; k += lanes) {
            let at = k / sides;
            let cell = first + step * vec2<u32>(at / size.y, at % size.y);
            touched = answer_triangle(s, cell, kind + k % sides, mode, phase > 0u) || touched;
        }
        if (phase > 0u) {
            changed = changed || touched;
            storageBarrier();
        } else if (!agreed(touched)) {
            return none_touched;
        }
    }
    return select(none_changed, some_changed, agreed(changed));
}

fn most_sweeps(mode: u32) -> u32 {
    switch mode {
        case 0u: { return 20u; }
        case 1u: { return 200u; }
        case 2u: { return 40u; }
        default: { return 1u; }
    }
}

// A triangle that was moved may have brought its neighbours near.
fn widen_box() {
    cells_box = vec4<u32>(
        max(cells_box.xy, vec2<u32>(1u)) - 1u, min(cells_box.zw + 1u, cell_counts() - 1u));
}

// One sphere, by sweeps from the mode `first` on. Whether anything was moved.
fn keep_out(s: Swept, first: u32) -> bool {
    var any_moved = false;
    for (var i = lane; i < points(); i += lanes) {
        set_pushed(i, zero);
    }
    for (var round = 0; round < 6; round++) {
        find_candidates(s);
        var moved = false;
        var done = false;
        var mode = first;
        var count = 0u;
        while (!done) {
            let did = sweep(s, mode);
            moved = moved || did == some_changed;
            count++;
            if (did == some_changed && count < most_sweeps(mode)) {
                continue;
            }
            done = mode == telling || (mode != bouncing && did == none_touched);
            mode++;
            count = 0u;
        }
        if (!moved) {
            break;
        }
        any_moved = true;
        widen_box();
    }
    return any_moved;
}

const most_rounds = 30;  // from sphere to sphere

// Spheres in turn until none has moved anything; what they push into one another for ever has no place.
@compute @workgroup_size(256, 1, 1)
fn keep_faces_out(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    member_of_pass = id.z;
    lane = index;
    if (lane == 0u) {
        let at = faces_place(id.z);
        found_box = vec4<u32>(
            atomicExchange(&results[at], nowhere), atomicExchange(&results[at + 1u], nowhere),
            ~atomicExchange(&results[at + 2u], nowhere), ~atomicExchange(&results[at + 3u], nowhere));
    }
    cells_box = workgroupUniformLoad(&found_box);
    if (cells_box.x == nowhere) {
        return;
    }
    for (var round = 0; round <= most_rounds; round++) {
        let first = select(bouncing, telling, round == most_rounds);  // the last one only tells what is left
        var moved = false;
        for (var k = 0u; k < face_spheres; k++) {
            moved = keep_out(face_sphere(id.z, k), first) || moved;
        }
        if (!moved || face_spheres == 1u) {
            break;
        }
    }
}
