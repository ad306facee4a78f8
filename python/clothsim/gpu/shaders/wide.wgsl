// Responses in float64, for adapters that have it: the two parts of single precision join, as in
// the core.
fn widened(value: vec3<real>, low: vec3<real>) -> vec3<wide> {
    return select(vec3<wide>(value), vec3<wide>(value) + vec3<wide>(low), compensated);
}

fn spot_of(body: Body) -> Spot {
    return Spot(widened(body.position, body.position_low), vec3<wide>());
}
fn spot_from(a: Spot, b: Spot) -> vec3<wide> { return a.whole - b.whole; }
fn beyond(a: Spot, d: vec3<wide>) -> Spot { return Spot(a.whole + d, vec3<wide>()); }

fn velocity_of(body: Body) -> vec3<wide> { return widened(body.velocity, body.velocity_low); }

fn body_at(body: Body, at: Spot, velocity: vec3<wide>) -> Body {
    let x = vec3<real>(at.whole);
    let v = vec3<real>(velocity);
    let x_low = vec3<real>(at.whole - vec3<wide>(x));
    return Body(x, x_low, v, vec3<real>(velocity - vec3<wide>(v)));
}
