// Responses in float64, for adapters that have it: the two parts of single precision join, as in
// the core.
fn wide_vector(value: vec3<real>, low: vec3<real>) -> vec3<wide> {
    return select(vec3<wide>(value), vec3<wide>(value) + vec3<wide>(low), compensated);
}

fn spot_of(point: PointState) -> Spot {
    return Spot(wide_vector(point.position, point.position_low), vec3<wide>());
}
fn spot_difference(a: Spot, b: Spot) -> vec3<wide> { return a.whole - b.whole; }
fn spot_sum(a: Spot, d: vec3<wide>) -> Spot { return Spot(a.whole + d, vec3<wide>()); }

fn velocity_of(point: PointState) -> vec3<wide> {
    return wide_vector(point.velocity, point.velocity_low);
}

fn state_at_spot(point: PointState, at: Spot, velocity: vec3<wide>) -> PointState {
    let x = vec3<real>(at.whole);
    let v = vec3<real>(velocity);
    let x_low = vec3<real>(at.whole - vec3<wide>(x));
    return PointState(x, x_low, v, vec3<real>(velocity - vec3<wide>(v)));
}
