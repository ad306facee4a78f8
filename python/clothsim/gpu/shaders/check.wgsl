// The first mass point of every member that is not finite or too fast, into `results`.
@compute @workgroup_size(group_size, group_size, 1)
fn check(@builtin(global_invocation_id) id: vec3<u32>) {
    if (!inside(id)) {
        return;
    }
    let limit = parameters[id.z * constants.parameter_stride + 4u];
    var good = true;
    for (var k = 0u; k < 3u; k++) {
        let x = state[place(id) + k * points()];
        let v = state[place(id) + (3u + k) * points()];
        good = good && is_finite(x) && is_finite(v) && abs(v) <= limit;
    }
    if (!good) {
        atomicMin(&results[1u + id.z], id.y * constants.columns + id.x);
    }
}
