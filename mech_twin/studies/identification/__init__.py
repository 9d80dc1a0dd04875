# SPDX-License-Identifier: Apache-2.0
"""Identification of a machine's parameters from measured runs; `identification` is the method step by step.

What it uses builds up in this order.  `keyed_configuration` has the question, and a configuration as a function of its
keys.  `fit_runs` has measured runs and simulations at their instants, `fit_problem` unknowns, residuals, derivatives.
`fit_quality` judges a fit by the noise, and `staged_fit` finds it.  `intervals`, `refits` and `causes` tell how sure it
is, and `verdicts` what follows for each key.

Beside it stand lengths in a measured motion (`geometry_fit`), restitution (`bounces`), what sensors would find
(`sensor_plan`), and what is written (`written_identification`, `report_page`).
"""
