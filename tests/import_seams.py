"""A contract for import-linter: a package is entered through its ``__init__``, never past it."""

from typing import cast

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output


class SeamsContract(Contract):
    """Nobody outside of a package imports one of its modules; packages that only hold others are listed as open."""

    type_name = "seams"

    open_packages = fields.SetField(subfield=fields.StringField())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:  # noqa: FBT001 - as import-linter calls it
        """Every import of a module from outside of the package that it belongs to."""
        del verbose
        open_packages = cast("set[str]", self.open_packages)  # a field gives the value that is configured
        modules = {
            name for name in graph.modules if not graph.is_module_squashed(name) and not graph.find_children(name)
        }
        past = sorted(
            f"{importer} imports {module}: import from {package} instead"
            for module in modules
            if (package := module.rpartition(".")[0]) in graph.modules and package not in open_packages
            for importer in graph.find_modules_that_directly_import(module)
            if not f"{importer}.".startswith(f"{package}.")
        )
        return ContractCheck(kept=not past, metadata={"past": past})

    def render_broken_contract(self, check: ContractCheck) -> None:
        """One line an import."""
        for line in check.metadata["past"]:
            output.print_error(line, bold=False)
