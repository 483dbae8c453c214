"""Datasets in locations: folders and tar files that appear whole, an index, parts of them."""

import gzip
import json
import tarfile
import tempfile
from importlib.util import find_spec
from pathlib import Path

import pandas as pd
import pytest
from fsspec.implementations.memory import MemoryFileSystem
from terminal import driftyard

import driftyard as dy
from sim.certificate.verify import verify
from trials.execution.location import Location, StoreError
from trials.shards.catalogue import INDEX, read_entries
from trials.shards.checking import find_damage
from trials.shards.fetching import fetch, fetch_all
from trials.shards.selection import parse_selection, select
from trials.shards.writing import ShardWriter, send_folder
from vo.contract.errors import DatasetError, SettingsError

pytestmark = pytest.mark.gl

YARD = """<mujoco><asset>
<texture name="t" type="2d" builtin="checker" rgb1=".2 .3 .4" rgb2=".6 .6 .5"
 width="64" height="64"/>
<material name="t" texture="t" texrepeat="4 4" texuniform="true"/></asset><worldbody>
<light pos="0 0 4"/><geom type="plane" size="5 5 1" material="t"/></worldbody></mujoco>"""
SETTINGS = ("rig.width_px=64", "rig.height_px=48", "drive.distance_m=0.02", "render.samples=0")
TINY = [
    word
    for setting in (*SETTINGS, "render.shadow_size_px=256", "labels.flow=true")
    for word in ("--set", setting)
]
NAMES = ["yard-00000", "yard-00001"]


def content(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def yard(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("yard")
    (folder / "yard.xml").write_text(YARD)
    return folder


def generate(yard: Path, out: object, *words: object) -> str:
    """Record into a location; return what is said on stdout."""
    result = driftyard(
        "generate", "yard.xml", "--out", out, *TINY, "--workers", 0, *words, cwd=yard
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def folders(yard) -> Path:
    """Two datasets."""
    generate(yard, "folders", "--count", 2)
    return yard / "folders"


@pytest.fixture(scope="module")
def shards(folders, tmp_path_factory) -> Location:
    """Both in one tar file."""
    location = Location(str(tmp_path_factory.mktemp("shards")))
    with ShardWriter(location, "both", tmp_path_factory.mktemp("temporary")) as writer:
        for name in NAMES:
            writer.add(folders / name)
        writer.commit()
    return location


@pytest.fixture(scope="module")
def bucket():
    """A bucket of an S3 server on this machine."""
    if not (find_spec("moto") and find_spec("s3fs")):
        pytest.skip("moto or s3fs is not installed")
    import boto3
    from moto.server import ThreadedMotoServer

    with pytest.MonkeyPatch.context() as patch:
        server = ThreadedMotoServer(port=0, verbose=False)
        server.start()
        address = "http://{}:{}".format(*server.get_host_and_port())
        for name, value in {
            "AWS_ENDPOINT_URL": address,
            "AWS_ACCESS_KEY_ID": "x",
            "AWS_SECRET_ACCESS_KEY": "x",
            "AWS_DEFAULT_REGION": "us-east-1",
        }.items():
            patch.setenv(name, value)
        boto3.client("s3").create_bucket(Bucket="bucket")
        yield "s3://bucket"
        server.stop()


def test_generate_location_holds_what_a_folder_holds(yard, folders, tmp_path, monkeypatch):
    url = "memory://generate/many"
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path.parent))
    killed = tmp_path.parent / "driftyard-recording-x"
    killed.mkdir()
    (killed / "left").touch()
    assert generate(yard, url, "--count", 2).endswith(f"2 datasets in {url}\n")
    for name, entry in read_entries(Location(url)).items():
        fetch(entry, None, tmp_path / name)
    assert content(tmp_path) == content(folders)
    assert not killed.exists()

    store = MemoryFileSystem()
    half = store.cat_file("/generate/many/yard-00001/dataset.json")[:-9]
    store.pipe_file("/generate/many/yard-00001/dataset.json", half)
    store.pipe_file("/generate/many/yard-00001/mav0/flow0/data/left.tiff", b"by a killed worker")
    listed = driftyard("index", url, cwd=yard)
    assert "1 folders without a complete dataset.json, as yard-00001, do not" in listed.stderr
    assert listed.stdout.splitlines()[1].split()[:3] == ["yard", "1", "0"]
    assert "1 of 2 datasets are there already" in generate(yard, url, "--count", 2)
    assert not list(find_damage([*read_entries(Location(url)).values()]))
    assert not store.exists("/generate/many/yard-00001/mav0/flow0/data/left.tiff")

    words = ("generate", "yard.xml", "--out", url, "--count", 1, *TINY, "--workers", 0)
    other = driftyard(*words, "--set", "drive.distance_m=0.03", cwd=yard)
    assert other.returncode == 2
    assert "many/yard-00000: exists with other settings" in other.stderr


def test_generate_shards_hold_each_dataset_once(yard, folders, tmp_path):
    out = tmp_path / "shards"
    generate(yard, out, "--count", 1, "--shard", 2)
    before = content(out)
    said = generate(yard, out, "--count", 2, "--shard", 2)
    assert "1 of 2 datasets are there already" in said
    after = content(out)
    assert before.items() < after.items()
    assert len(after) == 4
    entries = read_entries(Location(str(out)))
    assert [*entries] == NAMES
    for name, entry in entries.items():
        expected, files = content(folders / name), entry.files
        assert files.keys() == expected.keys()
        for path, data in expected.items():
            file, start, size = files[path]
            assert after[file][start : start + size] == data

    last = max(x for x in after if x.endswith(INDEX))
    (out / last).write_bytes(after[last][:-9])
    listed = driftyard("index", out, cwd=yard)
    assert f"{last} is incomplete" in listed.stderr
    assert "1 tar files without index" in listed.stderr
    assert listed.stdout.splitlines()[1].split()[:3] == ["yard", "1", "0"]
    generate(yard, out, "--count", 2, "--shard", 2)
    assert content(out) == after


def test_generate_one_dataset_at_a_location(yard, folders):
    url = "memory://generate/one"
    generate(yard, url)
    words = ("generate", "yard.xml", "--out", url, *TINY)
    again = driftyard(*words, cwd=yard)
    assert (again.returncode, again.stderr) == (
        2,
        f"driftyard: error: {url}: already exists; choose another location or --overwrite\n",
    )
    (entry,) = read_entries(Location(url)).values()
    assert entry.name == "one"
    assert entry.files.keys() == content(folders / "yard-00000").keys()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--out", "nowhere://x", "--count", "2"], "store nowhere://x: cannot be used"),
        (["--out", "nowhere://x"], "store nowhere://x: cannot be used"),
        (["--out", "/proc/x", "--shard", "1"], "store /proc/x: cannot be written"),
        (["--out", "memory://x", "--count", "2", "--workers", "2"], "add --workers 0"),
        (["--out", "x", "--store", "x"], "--store: generate writes its datasets to --out"),
    ],
)
def test_generate_unusable_location_is_one_line(yard, words, said):
    result = driftyard("generate", "yard.xml", *words, *TINY, cwd=yard)
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert said in line


def test_shards_are_samples_of_webdataset(shards):
    (file,) = Path(shards.url).glob("*.tar")
    with tarfile.open(file) as tar:
        names = tar.getnames()
    samples = [x for x in names if not x.startswith("__")]
    first = [x.partition(".")[2] for x in samples if x.startswith("yard-00000_000000.")]
    assert first == ["left.png", "right.png", "depth.tiff", "disparity.tiff", "flow.tiff", "json"]


def test_shards_of_equal_datasets_are_equal(shards, folders, tmp_path):
    other = Location(str(tmp_path / "other"))
    with ShardWriter(other, "both", tmp_path) as writer:
        for name in NAMES:
            writer.add(folders / name)
        writer.commit()
    assert content(Path(other.url)) == content(Path(shards.url))


def test_large_shards_are_split(folders, tmp_path, monkeypatch):
    monkeypatch.setattr("trials.shards.writing.SHARD_BYTES", 300_000)
    location = Location(str(tmp_path / "split"))
    with ShardWriter(location, "both", tmp_path) as writer:
        writer.add(folders / NAMES[0])
        writer.commit()
    (entry,) = read_entries(location).values()
    assert len(entry.shards) > 1
    assert not list(find_damage([entry]))
    fetch(entry, None, tmp_path / NAMES[0])
    assert content(tmp_path / NAMES[0]) == content(folders / NAMES[0])


def test_index_names_what_is_damaged(shards, folders, tmp_path):
    damaged = tmp_path / "damaged"
    for name, data in content(Path(shards.url)).items():
        damaged.mkdir(exist_ok=True)
        (damaged / name).write_bytes(data if name.endswith("gz") else data[:-5000] + b"x" * 5000)
    result = driftyard("index", "damaged", "--verify", cwd=tmp_path)
    assert result.returncode == 1
    assert "damaged/both-000000.tar: differs from its checksum" in result.stdout
    assert driftyard("index", shards.url, folders, "--verify", cwd=tmp_path).returncode == 0

    (damaged / "both-000000.tar").unlink()
    result = driftyard("index", "damaged", cwd=tmp_path)
    assert result.returncode == 2
    assert "both-000000.tar is missing, though both.index.json.gz lists it" in result.stderr


@pytest.mark.parametrize(
    ("text", "said"),
    [('{"schema_version": 2}', "has schema version 2"), ('{"schema_version": 1}', "is malformed")],
)
def test_index_of_another_kind_is_refused(tmp_path, text, said):
    (tmp_path / f"x{INDEX}").write_bytes(gzip.compress(text.encode()))
    with pytest.raises(StoreError, match=said):
        read_entries(Location(str(tmp_path)))


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_index_writes_one_row_a_frame(shards, folders, tmp_path, suffix):
    if suffix == "parquet":
        pytest.importorskip("pyarrow")
    file = tmp_path / f"frames.{suffix}"
    result = driftyard("index", shards.url, "--out", f"file://{file}", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    rows = pd.read_csv(file) if suffix == "csv" else pd.read_parquet(file)
    assert list(rows.frame[rows.dataset == NAMES[1]]) == [*range(len(rows) // 2)]
    row = rows.iloc[1]
    assert (row.scene, row.seed, row.labels) == ("yard", 0, "depth,disparity,flow")
    image = folders / NAMES[0] / f"mav0/cam1/data/{row.timestamp_ns}.png"
    data, start = (Path(shards.url) / row.shard).read_bytes(), int(row.right_offset)
    assert data[start : start + int(row.right_size)] == image.read_bytes()
    assert list(rows.flow_offset.isna()) == [x == rows.frame.max() for x in rows.frame]


def test_fetch_reads_only_what_it_needs(folders, tmp_path, monkeypatch):
    location = Location("memory://fetch")
    with ShardWriter(location, "both", tmp_path) as writer:
        for name in NAMES:
            writer.add(folders / name)
        writer.commit()
    read, cat_file = [], MemoryFileSystem.cat_file

    def counted(self, path, start=None, end=None, **words):
        data = cat_file(self, path, start, end, **words)
        read.append((path, len(data)))
        return data

    monkeypatch.setattr(MemoryFileSystem, "cat_file", counted)
    monkeypatch.setattr("trials.shards.fetching.GAP", 2000)
    result = driftyard(
        *("fetch", "memory://fetch", "--seed", "1", "--labels", "depth", "--out", "few"),
        cwd=tmp_path,
    )
    assert result.returncode == 0, result.stderr
    assert [x.name for x in (tmp_path / "few").iterdir()] == [NAMES[1]]
    part, whole = content(tmp_path / "few" / NAMES[1]), content(folders / NAMES[1])
    assert part.items() - whole.items() == {("dataset.json", part["dataset.json"])}
    assert not [x for x in part if "flow" in x or "disparity" in x]
    from_tar = sum(size for path, size in read if path.endswith(".tar"))
    needed = sum(map(len, part.values()))
    assert needed <= from_tar < needed + 2000 * len(part) < sum(map(len, whole.values()))

    (ds,) = dy.fetch("memory://fetch", tmp_path / "few", seeds=[1], labels=["depth"])
    assert ds.path == tmp_path / "few" / NAMES[1]
    assert ds.labels == ("depth",)
    assert ds.depth(0).shape == (48, 64)
    assert verify(ds.path) == []
    manifest = json.loads(part["dataset.json"])
    assert manifest["fetched_from"] == json.loads(whole["dataset.json"])["manifest_sha256"]

    words = ("fetch", "memory://fetch", "--seed", "1", "--out", "few")
    again = driftyard(*words, "--labels", "depth", cwd=tmp_path)
    assert "1 of 1 datasets are there already" in again.stdout
    other = driftyard(*words, "--labels", "flow", cwd=tmp_path)
    assert other.returncode == 2
    assert "few/yard-00001: exists with other content" in other.stderr


def test_fetch_names_a_damaged_file_and_leaves_nothing(shards, tmp_path):
    entry = read_entries(shards)[NAMES[0]]
    file, start, size = entry.files["map.png"]
    data = bytearray((Path(shards.url) / file).read_bytes())
    data[start + size // 2] ^= 1
    for name, whole in content(Path(shards.url)).items():
        (tmp_path / name).write_bytes(data if name == file else whole)
    damaged = read_entries(Location(str(tmp_path)))[NAMES[0]]
    with pytest.raises(StoreError, match=r"yard-00000/map\.png is damaged"):
        fetch(damaged, None, tmp_path / "few")
    assert not (tmp_path / "few").exists()
    with pytest.raises(StoreError, match=r"yard-00000/map\.png is damaged"):
        list(fetch_all([*read_entries(Location(str(tmp_path))).values()], None, tmp_path / "few"))
    assert [x.name for x in (tmp_path / "few").iterdir()] == [NAMES[1]]
    assert verify(tmp_path / "few" / NAMES[1]) == []


def test_location_hides_its_password():
    with pytest.raises(StoreError, match=r"store nowhere://me:\*\*\*@host/x: cannot be used"):
        Location("nowhere://me:secret@host/x").check()


def test_selection_says_what_there_is(shards, folders, tmp_path):
    for words in (("yard", "1", ""), ("yard.xml", "0-0,1-5", "flow,depth"), ("", "", "none")):
        found = select([shards.url], parse_selection(*words))
        assert [x.name for x in found] == NAMES[2 - len(found) :]
    where = [str(folders)]
    with pytest.raises(DatasetError, match="scenes are yard, seeds from 0 to 1"):
        select(where, parse_selection("office", "", ""))
    with pytest.raises(DatasetError, match="has no normals, only depth, disparity, flow"):
        select(where, parse_selection("", "", "normals"))
    with pytest.raises(DatasetError, match="holds no complete dataset"):
        select([str(tmp_path / "absent")], parse_selection("", "", ""))
    with pytest.raises(SettingsError, match="labels: there is no snow, only depth"):
        parse_selection("", "", "snow")
    with pytest.raises(SettingsError, match="--seed 3-x: expected seeds as 0-9,12"):
        parse_selection("", "3-x", "")


def test_bucket_of_s3_holds_folders_and_shards(bucket, folders, tmp_path):
    location = Location(f"{bucket}/many")
    location.check()
    send_folder(folders / NAMES[0], location, NAMES[0])
    with ShardWriter(location, "one", tmp_path) as writer:
        writer.add(folders / NAMES[1])
        writer.commit()
    result = driftyard("index", location.url, "--verify", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert driftyard("fetch", location.url, "--out", "all", cwd=tmp_path).returncode == 0
    assert content(tmp_path / "all") == content(folders)


def test_bucket_that_does_not_exist_is_one_line(bucket, yard):
    url = "s3://no-such-bucket/many"
    result = driftyard("generate", "yard.xml", "--out", url, "--count", 1, *TINY, cwd=yard)
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert f"store {url}: cannot be written (" in line
