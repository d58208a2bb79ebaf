//! STL: facets one by one, as 50 bytes each or as text.

use super::mesh_file::{FileMesh, says_right_anterior};

/// Bytes before the first facet: 80 of anything, and the number of facets.
const HEADER: usize = 84;
/// Three numbers of the normal, nine of the corners, two bytes of anything.
const FACET: usize = 50;

/// The facets of a file, at most `most`.
///
/// # Errors
/// What is wrong with it.
pub(super) fn parse(bytes: &[u8], most: usize) -> Result<FileMesh, String> {
    let count = bytes.get(HEADER - 4..HEADER).map(|count| u32::from_le_bytes([count[0], count[1], count[2], count[3]]));
    let expected = count.map_or(u64::MAX, |count| (HEADER + FACET * count as usize) as u64);
    // Binary files may begin with `solid` too.
    if bytes.len() as u64 != expected && bytes.trim_ascii_start().starts_with(b"solid") {
        return parse_text(bytes, most);
    }
    match count {
        Some(count) if expected <= bytes.len() as u64 => parse_binary(bytes, count as usize, most),
        Some(count) => Err(format!(
            "{count} facets of STL take {expected} bytes, found {}: it is cut short, or no STL",
            bytes.len()
        )),
        None => Err("too short for STL".to_owned()),
    }
}

fn parse_binary(bytes: &[u8], count: usize, most: usize) -> Result<FileMesh, String> {
    check_count(count, most)?;
    let mut mesh = FileMesh { is_right_anterior: says_right_anterior(&bytes[..HEADER]), ..FileMesh::default() };
    mesh.vertices.reserve_exact(3 * count);
    for facet in bytes[HEADER..].chunks_exact(FACET).take(count) {
        let (numbers, _) = facet[12..48].as_chunks::<4>();
        let (corners, _) = numbers.as_chunks::<3>();
        mesh.vertices.extend(corners.iter().map(|corner| corner.map(|number| f64::from(f32::from_le_bytes(number)))));
    }
    Ok(with_facets(mesh))
}

fn parse_text(bytes: &[u8], most: usize) -> Result<FileMesh, String> {
    let mut mesh = FileMesh::default();
    let mut is_complete = false;
    for (number, line) in bytes.split(|&byte| byte == b'\n').enumerate() {
        let at = |message: &str| format!("line {}: {message}", number + 1);
        let line = String::from_utf8_lossy(line);
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("solid") => mesh.is_right_anterior |= says_right_anterior(line.as_bytes()),
            Some("facet") if !mesh.vertices.len().is_multiple_of(3) => {
                return Err(at("a facet before has not three corners"));
            }
            Some("vertex") => {
                let mut coordinate = || words.next().and_then(|word| word.parse().ok());
                let (Some(x), Some(y), Some(z)) = (coordinate(), coordinate(), coordinate()) else {
                    return Err(at("expected `vertex X Y Z`"));
                };
                mesh.vertices.push([x, y, z]);
                check_count(mesh.vertices.len() / 3, most)?;
            }
            Some("endfacet") if !mesh.vertices.len().is_multiple_of(3) => {
                return Err(at("a facet has not three corners"));
            }
            Some("endsolid") => is_complete = true,
            _ => {}
        }
    }
    if !is_complete || !mesh.vertices.len().is_multiple_of(3) {
        return Err("it ends before `endsolid`: it is cut short, or no STL".to_owned());
    }
    Ok(with_facets(mesh))
}

pub(super) fn check_count(count: usize, most: usize) -> Result<(), String> {
    if count > most { Err(format!("more than {most} triangles are not drawn")) } else { Ok(()) }
}

fn with_facets(mut mesh: FileMesh) -> FileMesh {
    let facets = mesh.vertices.len() as u32 / 3;
    mesh.triangles = (0..facets).map(|facet| [3 * facet, 3 * facet + 1, 3 * facet + 2]).collect();
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "solid a SPACE=RAS\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1e0 0 0\nvertex 0 1 -0.5\n\
                        endloop\nendfacet\nendsolid a\n";

    fn binary(facets: u32) -> Vec<u8> {
        let mut bytes = b"solid, but binary".to_vec();
        bytes.resize(80, 0);
        bytes.extend(facets.to_le_bytes());
        let numbers = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, -0.5_f32];
        bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()).chain([0; 2]));
        bytes
    }

    #[test]
    fn both_kinds_hold_the_same_facet() {
        let from_text = parse(TEXT.as_bytes(), 1).expect("is STL");
        let from_bytes = parse(&binary(1), 1).expect("is STL");
        assert_eq!(from_text.vertices, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, -0.5]]);
        assert_eq!((from_bytes.vertices, from_bytes.triangles), (from_text.vertices, vec![[0, 1, 2]]));
        assert!(from_text.is_right_anterior && !from_bytes.is_right_anterior);
    }

    #[test]
    fn what_is_no_stl_is_refused_with_a_reason() {
        for (bytes, most, reason) in [
            (&b""[..], 9, "too short"),
            (&binary(u32::MAX)[..], usize::MAX, "cut short"),
            (&binary(1)[..133], 9, "cut short"),
            (&binary(1), 0, "more than 0"),
            (TEXT.replace("endsolid a\n", "").as_bytes(), 9, "cut short"),
            (TEXT.replace("1e0", "x").as_bytes(), 9, "line 5"),
            (TEXT.replace("vertex 0 0 0\n", "").as_bytes(), 9, "three corners"),
            (TEXT.as_bytes(), 0, "more than 0"),
        ] {
            let message = parse(bytes, most).expect_err(reason);
            assert!(message.contains(reason), "{message}");
        }
    }
}
