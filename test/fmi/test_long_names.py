# SPDX-License-Identifier: Apache-2.0
"""Code whose blocks have long names can be made into a unit: LLVM writes such names and does not read them."""

import llvmlite.binding as llvm
import pytest

from mech_twin.fmi.step_object import _LONG_NAME, _short_name

NAME = "_ZN9mech_twin" + 40 * "Equations_28array_28float64_2c_202d"
TEXT = f"""
define i64 @{NAME[:150]}(i1 %go, i64 %value) {{
entry:
  br i1 %go, label %{NAME}54.1, label %{NAME}54.thread-pre-split_crit_edge
{NAME}54.1:                ; preds = %entry
  %{NAME} = add i64 %value, 1
  br label %end
{NAME}54.thread-pre-split_crit_edge:
  br label %end
end:
  %result = phi i64 [ %{NAME}, %{NAME}54.1 ], [ 2, %{NAME}54.thread-pre-split_crit_edge ]
  ret i64 %result
}}
"""


def test_long_names_are_shortened_each_to_its_own() -> None:
    with pytest.raises(RuntimeError, match="name is too long"):
        llvm.parse_assembly(TEXT)
    module = llvm.parse_assembly(_LONG_NAME.sub(_short_name, TEXT))
    module.verify()
    (function,) = module.functions
    assert function.name == NAME[:150]
    assert len({block.name for block in function.blocks}) == 4
