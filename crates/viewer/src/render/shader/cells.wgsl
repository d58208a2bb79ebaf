// The cells that a ray goes through: the twin of reference/rays.rs. Cells are given by their lowest voxels.

fn is_forward(ray: Ray) -> vec3<bool> {
    return ray.direction >= vec3<f32>(0.0);
}

// The cell in the far corner.
fn last_cell() -> vec3<f32> {
    return max(vec3<f32>(frame.last_voxel) - 1.0, vec3<f32>(0.0));
}

// Where planes between voxels are crossed; never, where there is no cell behind.
fn crossings(ray: Ray, inverse: vec3<f32>, planes: vec3<f32>, never: f32) -> vec3<f32> {
    let is_inside = (planes > vec3<f32>(0.0)) & (planes <= last_cell());
    return select(vec3<f32>(never), (planes * frame.spacing - ray.origin) * inverse, is_inside);
}

fn exits_of(ray: Ray, inverse: vec3<f32>, cell: vec3<f32>) -> vec3<f32> {
    return crossings(ray, inverse, cell + select(vec3<f32>(0.0), vec3<f32>(1.0), is_forward(ray)), NOWHERE);
}

fn entries_of(ray: Ray, inverse: vec3<f32>, cell: vec3<f32>) -> vec3<f32> {
    return crossings(ray, inverse, cell + select(vec3<f32>(1.0), vec3<f32>(0.0), is_forward(ray)), -NOWHERE);
}

fn cell_at(ray: Ray, inverse: vec3<f32>, along: f32) -> vec3<f32> {
    let index = (ray.origin + along * ray.direction) * frame.inverse_spacing;
    // Rounding can be off by a cell, but not by two.
    let guess = clamp(floor(index), vec3<f32>(0.0), last_cell());
    let step = select(vec3<f32>(-1.0), vec3<f32>(1.0), is_forward(ray));
    let ahead = vec3<f32>(along) >= exits_of(ray, inverse, guess);
    let behind = vec3<f32>(along) < entries_of(ray, inverse, guess);
    return guess + select(vec3<f32>(0.0), step, ahead) - select(vec3<f32>(0.0), step, behind);
}

// The cell behind the nearest of a cell's exits.
fn next_cell(ray: Ray, cell: vec3<f32>, exits: vec3<f32>) -> vec3<f32> {
    let is_x = exits.x <= exits.y && exits.x <= exits.z;
    let is_y = !is_x && exits.y <= exits.z;
    let step = select(vec3<f32>(-1.0), vec3<f32>(1.0), is_forward(ray));
    return cell + select(vec3<f32>(0.0), step, vec3<bool>(is_x, is_y, !is_x && !is_y));
}

// How many cells a stretch of the ray goes through.
fn count_of_cells(ray: Ray, inverse: vec3<f32>, begin: f32, end: f32) -> u32 {
    if !(begin < end) {
        return 0u;
    }
    let step = select(vec3<f32>(-1.0), vec3<f32>(1.0), is_forward(ray));
    let at_end = cell_at(ray, inverse, end);
    let is_left = entries_of(ray, inverse, at_end) >= vec3<f32>(end);
    let cells = abs(at_end - select(vec3<f32>(0.0), step, is_left) - cell_at(ray, inverse, begin));
    return 1u + u32(cells.x + cells.y + cells.z);
}

// A cell and where it is entered.
struct CellPlace {
    cell: vec3<f32>,
    along: f32,
}

// Behind the cube of macrocells that are all closer than `empty` to that of a cell.
fn leap(ray: Ray, inverse: vec3<f32>, cell: vec3<f32>, empty: i32) -> CellPlace {
    let forward = is_forward(ray);
    let macrocell = vec3<i32>(cell) / MACROCELL;
    let planes = vec3<f32>(select(macrocell + 1 - empty, macrocell + empty, forward) * MACROCELL);
    let places = crossings(ray, inverse, planes, NOWHERE);
    let along = min(places.x, min(places.y, places.z));
    // Whatever a device rounds differently, a leap ends behind the plane that it leads to.
    let found = cell_at(ray, inverse, along);
    let behind = select(min(found, planes - 1.0), max(found, planes), forward);
    return CellPlace(select(found, behind, places <= vec3<f32>(along)), along);
}

// Where in a cell a place along the ray lies, 0 to 1 along each axis.
fn fraction_in(ray: Ray, cell: vec3<f32>, along: f32) -> vec3<f32> {
    let index = (ray.origin + along * ray.direction) * frame.inverse_spacing;
    return clamp(index - cell, vec3<f32>(0.0), min(vec3<f32>(frame.last_voxel), vec3<f32>(1.0)));
}
