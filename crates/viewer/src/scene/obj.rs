//! Wavefront OBJ: corners and the polygons between them, as text; everything else in it is passed over.

use super::mesh_file::{FileMesh, says_right_anterior};
use super::stl::check_count;

/// The polygons of a file as triangles, at most `most`.
///
/// # Errors
/// What is wrong with it, and in which line.
pub(super) fn parse(bytes: &[u8], most: usize) -> Result<FileMesh, String> {
    let mut mesh = FileMesh::default();
    for (number, line) in bytes.split(|&byte| byte == b'\n').enumerate() {
        let at = |message: String| format!("line {}: {message}", number + 1);
        if line.starts_with(b"#") {
            mesh.is_right_anterior |= says_right_anterior(line);
            continue;
        }
        let line = String::from_utf8_lossy(line);
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let mut coordinate = || words.next().and_then(|word| word.parse().ok());
                let (Some(x), Some(y), Some(z)) = (coordinate(), coordinate(), coordinate()) else {
                    return Err(at("expected `v X Y Z`".to_owned()));
                };
                mesh.vertices.push([x, y, z]);
                // No more corners than separate triangles have.
                check_count(mesh.vertices.len().div_ceil(3), most)?;
            }
            Some("f") => {
                let corners = words.map(|word| corner(word, mesh.vertices.len()));
                let corners = corners.collect::<Result<Vec<u32>, String>>().map_err(at)?;
                if corners.len() < 3 {
                    return Err(at("expected `f` with three corners or more".to_owned()));
                }
                check_count(mesh.triangles.len() + corners.len() - 2, most)?;
                mesh.triangles.extend((2..corners.len()).map(|last| [corners[0], corners[last - 1], corners[last]]));
            }
            _ => {}
        }
    }
    Ok(mesh)
}

/// The index of a corner: `V`, `V/T`, `V//N` or `V/T/N`, from 1 on, or backwards from −1.
fn corner(word: &str, known: usize) -> Result<u32, String> {
    let number = word.split('/').next().and_then(|number| number.parse::<i64>().ok());
    let index = match number {
        Some(number) if number > 0 => usize::try_from(number - 1).ok(),
        Some(number) if number < 0 => {
            usize::try_from(number.unsigned_abs()).ok().and_then(|back| known.checked_sub(back))
        }
        _ => None,
    };
    let index = index.filter(|&index| index < known).and_then(|index| u32::try_from(index).ok());
    index.ok_or_else(|| format!("`{word}` is none of the {known} corners before"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_become_triangles() {
        let text = "# SPACE=RAS\nv 0 0 0\nv 1 0 0 1.0\nvn 0 0 1\nv 1 1 0\nv 0 1 -0.5\r\nf 1/1 2//3 3/4/5 -1\n";
        let mesh = parse(text.as_bytes(), 4).expect("is OBJ");
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.vertices[3], [0.0, 1.0, -0.5]);
        assert!(mesh.is_right_anterior);
    }

    #[test]
    fn what_is_no_obj_is_refused_with_its_line() {
        for (text, most, reason) in [
            ("v 0 0\n", 9, "line 1"),
            ("v 0 0 x\n", 9, "line 1"),
            ("v 0 0 0\nf 1 1 2\n", 9, "line 2: `2`"),
            ("v 0 0 0\nf 1 1 0\n", 9, "`0`"),
            ("v 0 0 0\nf 1 1 -2\n", 9, "`-2`"),
            ("v 0 0 0\nf 1 1 -9223372036854775808\n", 9, "none of"),
            ("v 0 0 0\nf 1 1\n", 9, "three corners"),
            ("v 0 0 0\nf 1 1 1 1 1\n", 2, "more than 2"),
        ] {
            let message = parse(text.as_bytes(), most).expect_err(text);
            assert!(message.contains(reason), "{message}");
        }
        assert!(parse(b"\xff\x00 whatever", 9).expect("nothing in it").triangles.is_empty());
    }
}
