// Responses in float64, for adapters that have it: the two parts of single precision join, as in the core.
fn widened(value: vec3<real>, low: vec3<real>) -> vec3<wide> {
    if (compensated) {
        return vec3<wide>(value) + vec3<wide>(low);
    }
    return vec3<wide>(value);
}

fn narrowed(position: vec3<wide>, velocity: vec3<wide>) -> Body {
    let x = vec3<real>(position);
    let v = vec3<real>(velocity);
    return Body(x, vec3<real>(position - vec3<wide>(x)), v, vec3<real>(velocity - vec3<wide>(v)));
}

fn position_from(body: Body, contact: Contact) -> vec3<wide> {
    return widened(body.position, body.position_low) - contact.center;
}

fn velocity_of(body: Body) -> vec3<wide> {
    return widened(body.velocity, body.velocity_low);
}

fn moved_body(body: Body, contact: Contact, responded: Response) -> Body {
    var position = widened(body.position, body.position_low);
    if (responded.moved) {
        position = contact.center + responded.on_surface;
    }
    return narrowed(position, responded.velocity);
}
