// Notes the first mass point of every member that is not finite or too fast, and what `add_contact`
// notes of the last state.
@compute @workgroup_size(group_size, group_size, 1)
fn check(@builtin(global_invocation_id) id: vec3<u32>) {
    if (!inside(id)) { return; }
    let limit = parameters[id.z * constants.parameter_stride + 4u];
    _ = add_contacts(vec3<real>(), state_at(place(id)), state_at(place(id) + 3u * points()), id);
    for (var k = 0u; k < 6u; k++) {
        let value = state[place(id) + k * points()];
        if (!is_finite(value) || (k >= 3u && abs(value) > limit)) { note(bad, id); }
    }
}
