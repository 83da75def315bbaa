// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

namespace cama {

/// What the last step did. One member for every row of report.def.
struct StepReport {
#define CAMA_REPORT(type, name, value, ...) type name = value;
#include "cama/report.def"

  /// Adds the report of the next piece of a divided step.
  void add(const StepReport &piece);
};

/// Calls f(name, value) for every field.
template <class F> void visit(const StepReport &report, F &&f)
{
#define CAMA_REPORT(type, name, ...) f(#name, report.name);
#include "cama/report.def"
}

/// A row of the table of the report.
struct ReportInfo {
  std::string name, type, unit;
  std::string adds;   ///< "sum", "max" or "last"
  std::string help;
};
const std::vector<ReportInfo> &report_table();

}  // namespace cama
