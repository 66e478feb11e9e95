"""Writes trained networks: ONNX with half-precision weights, `weights.pt`, manifest entry."""

from __future__ import annotations

import argparse
import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn

from models.manifest import sha256_of, write_entry
from models.training import read_weights

Network = TypeVar("Network", bound=nn.Module)
MODELS = Path(__file__).parent
SMALLEST_HALVED = 64  # shorter tensors (biases, constants) stay in single precision


def load_into(network: Network, path: Path) -> Network:
    """Give a network a checkpoint's averaged weights, or shipped ones, for inference."""
    network.eval().load_state_dict(read_weights(path))
    return network


def with_half_weights(model: onnx.ModelProto) -> onnx.ModelProto:
    """The same graph with its large weights stored in half precision behind a cast."""
    casts = []
    for tensor in list(model.graph.initializer):
        values = numpy_helper.to_array(tensor)
        if values.dtype != "float32" or values.size < SMALLEST_HALVED:
            continue
        half = numpy_helper.from_array(values.astype("float16"), tensor.name + ".half")
        casts.append(helper.make_node("Cast", [half.name], [tensor.name], to=TensorProto.FLOAT))
        model.graph.initializer.remove(tensor)
        model.graph.initializer.append(half)
    nodes = [*casts, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    return model


def write_onnx(
    network: nn.Module,
    path: Path,
    inputs: Mapping[str, tuple[int, ...]],
    outputs: tuple[str, ...],
    axes: Mapping[str, dict[int, str]],
    *,
    note: str,
    properties: Mapping[str, str] | None = None,
) -> None:
    """Write a network as an ONNX file of any picture size.

    Args:
        network: takes and gives what the file does.
        path: the file.
        inputs: name and shape of an example of each.
        outputs: names.
        axes: names of the axes of free length, by input or output and number of the axis.
        note: description inside the file.
        properties: metadata inside the file.
    """
    buffer = io.BytesIO()
    torch.onnx.export(
        network.eval(),
        tuple(torch.rand(shape) for shape in inputs.values()),
        buffer,
        input_names=list(inputs),
        output_names=list(outputs),
        dynamic_axes=dict(axes),
        opset_version=18,
        dynamo=False,  # a hundred times faster than the new exporter, and the same graph here
    )
    model = with_half_weights(onnx.load_from_string(buffer.getvalue()))
    for node in model.graph.node:  # names of source files
        node.doc_string = ""
    model.doc_string = note
    if properties:
        helper.set_model_props(model, dict(properties))
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, path)


def arguments(description: str | None, out: Path) -> argparse.Namespace:
    """The options of an export, parsed: the checkpoint, and where to write."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--checkpoint", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=out)
    return parser.parse_args()


def run_export(
    description: str | None,
    load: Callable[[Path], Network],
    export: Callable[[Network, Path], None],
    shipped: Path,
    inputs: Mapping[str, str],
    outputs: Mapping[str, str],
) -> None:
    """The command of an export: writes a checkpoint's network as an ONNX file, and says its size.

    Beside the shipped file its weights are kept in half precision, and the manifest gets its entry.

    Args:
        description: of the command.
        load: gives a checkpoint's network.
        export: writes the ONNX file of a network.
        shipped: the file that is written unless another is named; its stem names the network.
        inputs: shape and meaning of each, for the manifest.
        outputs: likewise.
    """
    options = arguments(description, shipped)
    network = load(options.checkpoint)
    export(network, options.out)
    if options.out.parent == shipped.parent:
        write_weights(network, shipped.parent)
        update_manifest(shipped.stem, options.out, inputs, outputs)
    print(f"{options.out}: {options.out.stat().st_size / 1e6:.2f} MB")


def write_weights(network: nn.Module, folder: Path) -> None:
    """Keep a network's weights in half precision beside its ONNX file."""
    halves = {name: value.half() for name, value in network.state_dict().items()}
    torch.save(halves, folder / "weights.pt")


def update_manifest(
    name: str, weights: Path, inputs: Mapping[str, str], outputs: Mapping[str, str]
) -> None:
    """Write a network's entry into the manifest.

    Args:
        name: of the network.
        weights: its ONNX file, in the folder of its model card.
        inputs: shape and meaning of each.
        outputs: likewise.
    """
    write_entry(MODELS / "manifest.toml", name, entry(name, weights, inputs, outputs))


def entry(name: str, weights: Path, inputs: Mapping[str, str], outputs: Mapping[str, str]) -> str:
    """A network's entry in the manifest; arguments as of `update_manifest`."""
    folder = weights.parent.name
    tables = [
        f'[model.{name}]\nfile = "{folder}/{weights.name}"\n'
        f'sha256 = "{sha256_of(weights)}"\nlicence = "Apache-2.0"\ncard = "{folder}/README.md"'
    ]
    for kind, values in (("inputs", inputs), ("outputs", outputs)):
        lines = "\n".join(f'{key} = "{value}"' for key, value in values.items())
        tables.append(f"[model.{name}.{kind}]\n{lines}")
    return "\n\n".join(tables) + "\n"
