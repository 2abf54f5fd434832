"""A contract of import-linter: a file whose name begins with ``_`` is its own folder's."""

from typing import Any

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, output


class PrivateFiles(Contract):
    """``a._b`` is imported by files of ``a`` alone, tests apart."""

    type_name = "private"

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Which files of other folders import a private one."""
        past = [
            f"{importer} imports {module}"
            for module in sorted(graph.modules)
            if is_private(module)
            for importer in sorted(graph.find_modules_that_directly_import(module))
            if not is_of_folder(importer, module.rpartition(".")[0])
        ]
        return ContractCheck(kept=not past, metadata={"past": past})

    def render_broken_contract(self, check: ContractCheck) -> None:
        """One line for each."""
        past: list[Any] = check.metadata["past"]
        for line in past:
            output.print_error(line)


def is_private(module: str) -> bool:
    """Whether a file's name begins with one underscore."""
    name = module.rpartition(".")[2]
    return name.startswith("_") and not name.startswith("__")


def is_of_folder(module: str, folder: str) -> bool:
    """Whether a file lies in a folder, or is the folder's own."""
    return module == folder or module.rpartition(".")[0] == folder
