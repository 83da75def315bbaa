// SPDX-License-Identifier: Apache-2.0
#include "cama/report.hpp"

#include <algorithm>
#include <type_traits>

namespace cama {

void StepReport::add(const StepReport &piece)
{
#define SUM(a, b) (a) + (b)
#define MAX(a, b) std::max(a, b)
#define LAST(a, b) (b)
#define CAMA_REPORT(type, name, value, unit, adds, help) name = adds(name, piece.name);
#include "cama/report.def"
#undef SUM
#undef MAX
#undef LAST
}

const std::vector<ReportInfo> &report_table()
{
#define SUM "sum"
#define MAX "max"
#define LAST "last"
#define CAMA_REPORT(type, name, value, unit, adds, help) \
  {#name, std::is_same_v<type, double> ? "number" : "integer", unit, adds, help},
  static const std::vector<ReportInfo> table = {
#include "cama/report.def"
  };
#undef SUM
#undef MAX
#undef LAST
  return table;
}

}  // namespace cama
