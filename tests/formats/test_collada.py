from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from trailmark.errors import FormatError
from trailmark.formats import collada
from trailmark.formats.collada import read_collada

SQUARE = "0 0 0  2 0 0  2 0 1  0 0 1"  # a 2 x 1 rectangle in (x, z)
TRIANGLES = '<triangles count="2"><input offset="0" semantic="VERTEX" source="#v"/><p>0 1 2 0 2 3</p></triangles>'


def document(
    nodes: str = '<instance_geometry url="#g"/>',
    faces: str = TRIANGLES,
    positions: str = SQUARE,
    extra: str = "",
    head: str = "",
    up: str = "<up_axis>Z_UP</up_axis>",
) -> str:
    count = len(positions.split())
    return f"""<?xml version="1.0" encoding="UTF-8"?>{head}
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>{up}</asset>
<library_visual_scenes><visual_scene id="s"><node id="n">{nodes}</node></visual_scene></library_visual_scenes>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="{count}">{positions}</float_array><technique_common>
<accessor source="#pa" count="{count // 3}" stride="3"/></technique_common></source>
<source id="uv"><float_array id="uva" count="4">0 0 1 1</float_array><technique_common>
<accessor source="#uva" count="2" stride="2"/></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>{faces}</mesh></geometry></library_geometries>
{extra}<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def read(tmp_path: Path, text: str | bytes) -> collada.Mesh:
    file = tmp_path / "m.dae"
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_collada(file)


def plane(mesh: collada.Mesh) -> list[list[float]]:
    """The different corners seen in the plane, sorted."""
    return sorted(map(list, {tuple(point) for point in mesh.triangles[..., :2].reshape(-1, 2).round(9).tolist()}))


@pytest.mark.parametrize(
    ("up", "corners"),
    [
        ("<up_axis>Z_UP</up_axis>", [[0, 0], [0, 1], [2, 0], [2, 1]]),  # (x, z)
        ("<up_axis>Y_UP</up_axis>", [[0, 0], [2, 0]]),  # (x, y): seen edge-on
        ("", [[0, 0], [2, 0]]),  # y is up unless said
        ("<up_axis>X_UP</up_axis>", [[0, 0], [0, 2]]),  # (-y, x): edge-on
    ],
)
def test_up_axis(tmp_path: Path, up: str, corners: list[list[float]]) -> None:
    assert plane(read(tmp_path, document(up=up))) == corners


@pytest.mark.parametrize(
    ("transform", "low", "high"),
    [
        ("<matrix>10 0 0 5  0 10 0 0  0 0 10 -3  0 0 0 1</matrix>", [5, -3], [25, 7]),
        ("<translate>5 9 -3</translate>", [5, -3], [7, -2]),
        ("<scale>2 1 3</scale>", [0, 0], [4, 3]),
        ("<rotate>0 1 0 90</rotate>", [0, -2], [1, 0]),  # about y: x goes to -z, z to x
        ("<rotate>0 5 0 90</rotate>", [0, -2], [1, 0]),
        ("<translate>1 0 0</translate><scale>2 2 2</scale>", [1, 0], [5, 2]),  # the last one first
        ("<scale>2 2 2</scale><translate>1 0 0</translate>", [2, 0], [6, 2]),
    ],
)
def test_node_transforms(tmp_path: Path, transform: str, low: list[float], high: list[float]) -> None:
    mesh = read(tmp_path, document(nodes=transform + '<instance_geometry url="#g"/>'))
    corners = np.array(plane(mesh))
    assert corners.min(axis=0).tolist() == pytest.approx(low)
    assert corners.max(axis=0).tolist() == pytest.approx(high)
    assert mesh.vertices[:, :2].max(axis=0).tolist() == pytest.approx(high)


def test_nested_nodes_and_instances(tmp_path: Path) -> None:
    mesh = read(
        tmp_path,
        document(
            nodes="<translate>10 0 0</translate>"
            '<node><scale>2 2 2</scale><instance_node url="#part"/></node>'
            '<node><instance_node url="#part"/></node>',
            extra='<library_nodes><node id="part"><translate>1 0 0</translate><instance_geometry url="#g"/></node>'
            "</library_nodes>",
        ),
    )
    assert plane(mesh) == [[11, 0], [11, 1], [12, 0], [12, 2], [13, 0], [13, 1], [16, 0], [16, 2]]
    assert len(mesh.vertices) == 8


INPUT = '<input offset="0" semantic="VERTEX" source="#v"/>'


@pytest.mark.parametrize(
    ("faces", "triangles", "polygons"),
    [
        (TRIANGLES, [[0, 1, 2], [0, 2, 3]], []),
        (f"<polylist>{INPUT}<vcount>3 4</vcount><p>0 1 2 0 1 2 3</p></polylist>", [[0, 1, 2]], [[0, 1, 2, 3]]),
        (f"<polygons>{INPUT}<p>0 1 2</p><p>0 1 2 3</p></polygons>", [[0, 1, 2]], [[0, 1, 2, 3]]),
        (f"<trifans>{INPUT}<p>0 1 2 3</p></trifans>", [[0, 1, 2], [0, 2, 3]], []),
        (f"<tristrips>{INPUT}<p>0 1 3 2</p></tristrips>", [[0, 1, 3], [1, 3, 2]], []),
    ],
)
def test_kinds_of_faces(tmp_path: Path, faces: str, triangles: list[list[int]], polygons: list[list[int]]) -> None:
    corners = np.array([[0, 0], [2, 0], [2, 1], [0, 1]])
    mesh = read(tmp_path, document(faces=faces))
    assert np.array_equal(mesh.triangles[..., :2], corners[triangles])
    assert len(mesh.polygons) == len(polygons)
    assert all(np.array_equal(a[:, :2], corners[b]) for a, b in zip(mesh.polygons, polygons, strict=True))


def test_vertices_differ_by_position_and_other_data_within_a_group(tmp_path: Path) -> None:
    uv = '<input offset="1" semantic="TEXCOORD" source="#uv"/>'
    shared = f"<triangles>{INPUT}{uv}<p>0 0 1 0 2 0  0 0 2 0 3 0</p></triangles>"  # corners 0 and 2 twice, same uv
    seam = f"<triangles>{INPUT}{uv}<p>0 0 1 0 2 0  0 1 2 1 3 1</p></triangles>"  # with another uv
    lines = f"<lines>{INPUT}<p>0 1</p></lines>"
    assert len(read(tmp_path, document(faces=shared)).vertices) == 4
    assert len(read(tmp_path, document(faces=seam)).vertices) == 6
    assert len(read(tmp_path, document(faces=shared + seam)).vertices) == 10
    both = read(tmp_path, document(faces=shared + lines))
    assert len(both.vertices) == 6
    assert len(both.triangles) == 2


LAUGHS = (
    "<!DOCTYPE lolz ["
    + '<!ENTITY l0 "ha">'
    + "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 12))
    + "]>"
)


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        document(head=LAUGHS, positions="&l11;").encode(),
        document(head='<!DOCTYPE x SYSTEM "file:///etc/passwd">').encode(),
        document(head='<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>', positions="&e;").encode(),
        document(head=LAUGHS, positions="&l11;").replace("UTF-8", "UTF-16").encode("utf-16"),
    ],
)
def test_document_types_and_entities_are_refused(tmp_path: Path, text: bytes) -> None:
    begin = time.process_time()
    with pytest.raises(FormatError, match="expected no document type and no entities"):
        read(tmp_path, text)
    assert time.process_time() - begin < 5.0


DEEP = "".join(
    f'<node id="d{i}"><instance_node url="#d{i + 1}"/><instance_node url="#d{i + 1}"/></node>' for i in range(40)
)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "not valid XML: no element found"),
        ("hello", "m.dae:1: not valid XML: syntax error"),
        ("<COLLADA>\n<a></b></COLLADA>", "m.dae:2: not valid XML: mismatched tag"),
        ("<svg/>", "expected <COLLADA>, got <svg>"),
        ("<COLLADA/>", "expected an <instance_visual_scene>, got none"),
        (document().replace('url="#s"', 'url="#x"'), "<instance_visual_scene> refers to '#x', which is not there"),
        (document(nodes='<instance_geometry url="#h"/>'), "<instance_geometry> refers to '#h', which is not there"),
        (document(nodes='<instance_node url="#n"/>'), "expected nodes nested at most 64 levels deep, got more"),
        (document(nodes="<matrix>1 2 3</matrix>"), "expected 16 numbers, got 3"),
        (document(nodes="<lookat>1 2 3</lookat>"), "expected <matrix>, <translate>, <rotate>, <scale>, got <lookat>"),
        (document(positions=SQUARE.replace("2", "nan")), "a coordinate that is not a finite number given"),
        (document(positions=SQUARE.replace("2", "9e15")), "expected coordinates of at most 1e+08 m, got 9e+15 m"),
        (document(positions="0 0 0 1 0 0"), "input POSITION has an index beyond its 2 entries"),
        (document(faces=TRIANGLES.replace("0 1 2", "0 1 -2")), "input POSITION has an index beyond its 4 entries"),
        (document(faces="<triangles><p>0 1 2</p></triangles>"), "<triangles> has no input VERTEX"),
        (document(faces=TRIANGLES.replace("#v", "#uv").replace("0 1 2 0 2 3", "0 1 0")), "<triangles> has no"),
        (document(faces=TRIANGLES.replace("#v", "#w")), "<input> refers to '#w', which is not there"),
        (document(faces=f"<polylist>{INPUT}<vcount>9</vcount><p>0 1 2</p></polylist>"), "<vcount> asks for 9 corners"),
        (document(faces=f"<polygons>{INPUT}<ph/><p>0 1 2</p></polygons>"), "expected polygons without holes, got"),
        (document(faces=TRIANGLES.replace('offset="0"', 'offset="3"')), "no multiple of 4"),
        (document(faces=TRIANGLES.replace('offset="0"', 'offset="x"')), "expected a whole number, 0 or more, got 'x'"),
        (document().replace('count="4"', 'count="-4"'), "<accessor> count: expected a whole number, 0 or more,"),
        (document().replace('stride="3"', 'stride="9"'), "<accessor> asks for 4 x 9 numbers, 12 are there"),
        (document(up="<up_axis>UP</up_axis>"), "expected X_UP, Y_UP, Z_UP, got 'UP'"),
    ],
)
def test_bad_meshes(tmp_path: Path, text: str, problem: str) -> None:
    with pytest.raises(FormatError) as caught:
        read(tmp_path, text)
    assert problem in str(caught.value)


def test_instances_that_multiply_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(collada, "MAX_FACES", 1000)
    nodes = f'<library_nodes>{DEEP}<node id="d40"><instance_geometry url="#g"/></node></library_nodes>'
    with pytest.raises(FormatError, match="expected at most 1,000 nodes and faces placed, got more"):
        read(tmp_path, document(nodes='<instance_node url="#d0"/>', extra=nodes))
