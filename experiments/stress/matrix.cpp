#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <iterator>
#include <map>
#include <string_view>
#include <utility>

#include <palpate/result.h>
#include "experiments/driver/json_document.h"
#include "experiments/driver/suite.h"
#include "experiments/stress/stress.h"
#include "toolkit/core/files.h"

namespace palpate::experiments {
namespace {

std::string command_of(const RendererRequest& request, const std::string& name) {
  return fmt::format("palpate test stress --renderers {} --cases {} --out out/{}", spelled(request), name,
                     name);
}

std::string cause_of(const StressMatrix& matrix, std::size_t r, std::size_t c) {
  const StressCell& cell = matrix.cells[r][c];
  const std::string reason = known_reason(matrix.renderers[r], matrix.cases[c], cell);
  if (reason.empty()) return cell.cause;
  return cell.cause + (cell.cause.empty() ? "" : ". ") + reason;
}

const char* colour_of(CellStatus status) noexcept {
  constexpr const char* kColours[] = {"#009e73", "#f0e442", "#d55e00", "#e6e6e6"};  // of Okabe and Ito
  return kColours[static_cast<std::size_t>(status)];
}

constexpr CellStatus kStatuses[] = {CellStatus::kOk, CellStatus::kLimit, CellStatus::kFailed,
                                    CellStatus::kSkipped};

std::size_t count_of(const std::vector<StressCell>& row, CellStatus status) {
  return static_cast<std::size_t>(
      std::count_if(row.begin(), row.end(), [&](const StressCell& cell) { return cell.status == status; }));
}

/// Cells of this status by broken requirement: "felt: CASE, CASE; free: CASE", or "none".
std::string stress_cells_text(const std::vector<StressCell>& row, CellStatus status) {
  constexpr std::size_t kMostNamed = 16;  // per requirement; more failures stem from the method itself
  std::map<std::string, std::vector<std::string>> by_check;
  for (const StressCell& cell : row)
    if (cell.status == status) by_check[cell.check].push_back(cell.name);
  std::string text;
  for (const auto& [check, names] : by_check) {
    if (!text.empty()) text += "; ";
    if (!check.empty()) text += check + ": ";
    if (names.size() > kMostNamed)
      text += fmt::format("{} cells", names.size());
    else
      text += fmt::format("{}", fmt::join(names, ", "));
  }
  return text.empty() ? "none" : text;
}

DocumentJson stress_row_json(const StressMatrix& matrix, std::size_t r) {
  DocumentJson row = {{"label", matrix.renderers[r].label}, {"role", name_of(matrix.roles[r])}};
  for (const CellStatus status : kStatuses) row[name_of(status)] = count_of(matrix.cells[r], status);
  row["failed_cells"] = stress_cells_text(matrix.cells[r], CellStatus::kFailed);
  row["limit_cells"] = stress_cells_text(matrix.cells[r], CellStatus::kLimit);
  return row;
}

/// Lists failed cells, each with a command to rerun it, then limits.
Fact fact_of(const StressMatrix& matrix, std::size_t r) {
  Fact fact{matrix.renderers[r].label, {}};
  for (const CellStatus status : {CellStatus::kFailed, CellStatus::kLimit})
    for (std::size_t c = 0; c < matrix.cases.size(); ++c) {
      if (matrix.cells[r][c].status != status) continue;
      const std::string cause = cause_of(matrix, r, c);
      std::string text = fmt::format("{}, {}: {}{}", matrix.cases[c].name, name_of(status), cause,
                                     cause.ends_with('.') ? "" : ".");
      if (status == CellStatus::kFailed) text += " " + command_of(matrix.renderers[r], matrix.cases[c].name);
      fact.sentences.push_back(std::move(text));
    }
  return fact;
}

}  // namespace

std::string spelled(const RendererRequest& request) {
  std::string text = request.name;
  for (const auto& [key, value] : request.options.all()) text += fmt::format(":{}={}", key, value);
  return text;
}

std::size_t failures(const StressMatrix& matrix, render::Role role) {
  std::size_t count = 0;
  for (std::size_t r = 0; r < matrix.cells.size(); ++r)
    if (matrix.roles[r] == role) count += count_of(matrix.cells[r], CellStatus::kFailed);
  return count;
}

Table stress_table(const StressMatrix& matrix) {
  Table table;
  table.title = "Renderers at the extremes";
  table.bad_means = "something that must hold did not";
  table.columns = {"case"};
  for (const RendererRequest& request : matrix.renderers) table.columns.push_back(request.label);
  std::string group;
  for (std::size_t c = 0; c < matrix.cases.size(); ++c) {
    if (matrix.cases[c].group != group) table.rows.push_back({{group = matrix.cases[c].group}});
    std::vector<Cell> row = {{matrix.cases[c].name}};
    for (const std::vector<StressCell>& cells : matrix.cells) {
      const StressCell& cell = cells[c];
      const bool failed = cell.status == CellStatus::kFailed;
      row.push_back({failed                                ? cell.check
                     : cell.status == CellStatus::kSkipped ? kMissingNumber
                                                           : name_of(cell.status),
                     false, failed});
    }
    table.rows.push_back(std::move(row));
  }
  table.notes = {
      "A red cell names what did not hold. limit: refused before the first frame with a message, or felt "
      "wrongly where a message had warned of it before the first frame. A dash: not run."};
  return table;
}

Table stress_summary(const StressMatrix& matrix) {
  Table table;
  table.title = "Cells of each renderer";
  table.columns = {"renderer", "role"};
  for (const CellStatus status : kStatuses) table.columns.emplace_back(name_of(status));
  for (std::size_t r = 0; r < matrix.cells.size(); ++r) {
    std::vector<Cell> row = {{matrix.renderers[r].label}, {std::string(name_of(matrix.roles[r]))}};
    for (const CellStatus status : kStatuses) {
      const std::size_t count = count_of(matrix.cells[r], status);
      row.push_back({format_count(count), false, status == CellStatus::kFailed && count > 0});
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

std::string stress_picture(const StressMatrix& matrix) {
  constexpr int kSquare = 14, kLeft = 170, kTop = 120, kSize = 11, kLegend = 24, kLetter = 7;
  const int columns = static_cast<int>(matrix.renderers.size()), rows = static_cast<int>(matrix.cases.size());
  const int width = kLeft + std::max(columns * kSquare, 260) + 60,
            height = kTop + rows * kSquare + kLegend + 8;
  std::string svg = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" height=\"{1}\" "
      "font-family=\"sans-serif\" font-size=\"{2}\"><rect width=\"{0}\" height=\"{1}\" fill=\"white\"/>\n",
      width, height, kSize);
  for (int r = 0; r < columns; ++r) {
    const int x = kLeft + r * kSquare + kSquare - 3;
    svg += fmt::format("<text transform=\"translate({},{}) rotate(-60)\">{}</text>\n", x, kTop - 5,
                       html_escaped(matrix.renderers[static_cast<std::size_t>(r)].label));
  }
  for (int c = 0; c < rows; ++c) {
    const StressCase& one = matrix.cases[static_cast<std::size_t>(c)];
    const int y = kTop + c * kSquare;
    svg += fmt::format("<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>\n", kLeft - 5, y + kSize,
                       html_escaped(one.name));
    for (int r = 0; r < columns; ++r) {
      const StressCell& cell = matrix.cells[static_cast<std::size_t>(r)][static_cast<std::size_t>(c)];
      svg += fmt::format(
          "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"{}\"><title>{}</title></rect>\n",
          kLeft + r * kSquare, y, kSquare - 1, kSquare - 1, colour_of(cell.status),
          html_escaped(
              fmt::format("{}, {}: {} {}", cell.renderer, cell.name, name_of(cell.status),
                          cause_of(matrix, static_cast<std::size_t>(r), static_cast<std::size_t>(c)))));
    }
  }
  int x = kLeft;
  for (const CellStatus status : kStatuses) {
    const int y = kTop + rows * kSquare + kLegend - kSquare;
    svg += fmt::format(
        "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"{}\"/><text x=\"{}\" y=\"{}\">{}</text>\n",
        x, y, kSquare - 1, kSquare - 1, colour_of(status), x + kSquare + 2, y + kSize, name_of(status));
    x += 2 * kSquare + kLetter * static_cast<int>(std::string(name_of(status)).size()) + 8;
  }
  return svg + "</svg>\n";
}

std::string stress_json(const StressMatrix& matrix) {
  DocumentJson json = begin_json(kStressSchema, matrix.head);
  json["cases"] = DocumentJson::array();
  for (const StressCase& one : matrix.cases)
    json["cases"].push_back({{"name", one.name}, {"group", one.group}, {"text", one.text}});
  json["renderers"] = DocumentJson::array();
  for (std::size_t r = 0; r < matrix.cells.size(); ++r)
    json["renderers"].push_back(stress_row_json(matrix, r));
  json["cells"] = DocumentJson::array();
  for (std::size_t r = 0; r < matrix.cells.size(); ++r)
    for (std::size_t c = 0; c < matrix.cells[r].size(); ++c) {
      const StressCell& cell = matrix.cells[r][c];
      json["cells"].push_back({{"renderer", cell.renderer},
                               {"role", name_of(matrix.roles[r])},
                               {"case", cell.name},
                               {"status", name_of(cell.status)},
                               {"check", text_or_null(cell.check)},
                               {"cause", text_or_null(cause_of(matrix, r, c))},
                               {"warnings", cell.warnings},
                               {"command", command_of(matrix.renderers[r], cell.name)},
                               {"frames", cell.frames},
                               {"contact_frames", cell.contact_frames},
                               {"bound_hits", cell.bound_hits},
                               {"largest_force_n", cell.largest_force_n},
                               {"twin_difference_n", cell.twin_difference_n},
                               {"twin_bound_n", cell.twin_bound_n},
                               {"trace_hash", text_or_null(cell.trace_hash)}});
    }
  return document_text(json);
}

Page stress_page(const StressMatrix& matrix) {
  Page page = begin_page("Haptic renderers at the extremes", matrix.head);
  Section section;
  section.id = "stress";
  section.title = "Stress matrix";
  section.opening = "<figure>" + stress_picture(matrix) + "</figure>";
  section.paragraphs.push_back(
      "Every renderer at every extreme. Each cell must answer with finite forces within the limit, in frames "
      "of less than 1 ms of processor time, the same again in a second replay; contact must end where the "
      "HIP is free and be felt where it is deep; and the forces must be those of the same scene at unit "
      "scale, to within rounding.");
  section.tables = {stress_summary(matrix), stress_table(matrix)};
  Fact cases{"Cases", {}};
  for (const StressCase& one : matrix.cases) cases.sentences.push_back(one.name + ": " + one.text);
  section.facts.push_back(std::move(cases));
  HeadlineGroup group{"Stress", {}};
  for (std::size_t r = 0; r < matrix.cells.size(); ++r) {
    if (Fact fact = fact_of(matrix, r); !fact.sentences.empty()) section.facts.push_back(std::move(fact));
    const std::vector<StressCell>& row = matrix.cells[r];
    group.lines.push_back(
        {matrix.renderers[r].label,
         fmt::format("{} of {} cells failed, {} refused with a message", count_of(row, CellStatus::kFailed),
                     row.size() - count_of(row, CellStatus::kSkipped), count_of(row, CellStatus::kLimit))});
  }
  page.sections.push_back(std::move(section));
  page.headlines.push_back(std::move(group));
  return page;
}

namespace {

// The matrix of all cells has some 2 MB.
constexpr std::uint64_t kMostAgainstBytes = std::uint64_t{256} << 20;

Error no_matrix(const std::string& file, const std::string& why) {
  return {fmt::format("{} is no {}: {}", file, kStressFile, why),
          "give the stress.json of another run of palpate test stress",
          {},
          0};
}

/// The renderer that a cell's command_of() names, with its options.
std::string renderer_in(const std::string& command) {
  constexpr std::string_view kLead = "--renderers ";
  const std::size_t at = command.find(kLead);
  if (at == std::string::npos) return {};
  const std::size_t begin = at + kLead.size();
  return command.substr(begin, command.find(' ', begin) - begin);
}

/// Undoes cause_of().
void take_reason_out(const std::string& reason, std::string& cause) {
  if (reason.empty() || !cause.ends_with(reason)) return;
  cause.resize(cause.size() - reason.size());
  if (cause.ends_with(". ")) cause.resize(cause.size() - 2);
}

}  // namespace

Result<StressMatrix> read_stress(const std::string& file) {
  using render::Role;
  constexpr Role kRoles[] = {Role::kOurs, Role::kLiteral, Role::kRival, Role::kReference, Role::kOracle};
  PALPATE_ASSIGN(const std::string text, read_file(file, kMostAgainstBytes));
  StressMatrix matrix;
  try {
    const nlohmann::json json = nlohmann::json::parse(text);
    if (json.at("schema") != kStressSchema)
      return no_matrix(file, fmt::format("its schema is not {}", kStressSchema));
    matrix.head = head_from(json);
    for (const nlohmann::json& one : json.at("cases")) {
      StressCase& read = matrix.cases.emplace_back();
      one.at("name").get_to(read.name);
      one.at("group").get_to(read.group);
      one.at("text").get_to(read.text);
    }
    for (const nlohmann::json& row : json.at("renderers")) {
      row.at("label").get_to(matrix.renderers.emplace_back().label);
      matrix.roles.push_back(*std::find_if(std::begin(kRoles), std::end(kRoles) - 1, [&](Role role) {
        return row.at("role") == std::string(name_of(role));
      }));
    }
    matrix.cells.resize(matrix.renderers.size());
    for (const nlohmann::json& one : json.at("cells")) {
      StressCell cell;
      one.at("renderer").get_to(cell.renderer);
      one.at("case").get_to(cell.name);
      cell.status = *std::find_if(std::begin(kStatuses), std::end(kStatuses) - 1,
                                  [&](CellStatus status) { return one.at("status") == name_of(status); });
      for (const auto& [key, value] : {std::pair{"check", &cell.check}, std::pair{"cause", &cell.cause}})
        if (one.at(key).is_string()) one.at(key).get_to(*value);
      one.at("warnings").get_to(cell.warnings);
      const std::string command = one.at("command").get<std::string>();
      for (std::size_t r = 0; r < matrix.renderers.size(); ++r) {
        if (matrix.renderers[r].label != cell.renderer) continue;
        matrix.renderers[r].name = renderer_in(command);
        matrix.cells[r].push_back(cell);
      }
    }
  } catch (const nlohmann::json::exception& error) {
    return no_matrix(file, error.what());
  }
  for (std::size_t r = 0; r < matrix.cells.size(); ++r) {
    if (matrix.cells[r].size() != matrix.cases.size())
      return no_matrix(file, "a renderer has not a cell of every case");
    for (std::size_t c = 0; c < matrix.cases.size(); ++c)
      take_reason_out(known_reason(matrix.renderers[r], matrix.cases[c], matrix.cells[r][c]),
                      matrix.cells[r][c].cause);
  }
  return matrix;
}

Result<OtherHashes> read_hashes(const std::string& file) {
  PALPATE_ASSIGN(const std::string text, read_file(file, kMostAgainstBytes));
  OtherHashes other;
  other.file = file;
  try {
    const DocumentJson json = DocumentJson::parse(text);
    if (json.at("schema") != kStressSchema)
      return no_matrix(file, fmt::format("its schema is not {}", kStressSchema));
    const DocumentJson& machine = json.at("machine");
    other.built_by = fmt::format("{}, {}", machine.value("compiler", "an unknown compiler"),
                                 machine.value("cpu", "an unknown processor"));
    for (const DocumentJson& cell : json.at("cells")) {
      if (cell.at("status") == "skipped") continue;
      const DocumentJson& hash = cell.at("trace_hash");
      other.of_cell[{cell.at("renderer"), cell.at("case")}] = hash.is_null() ? "" : hash.get<std::string>();
    }
  } catch (const nlohmann::json::exception& error) {
    return no_matrix(file, error.what());
  }
  if (other.of_cell.empty()) return no_matrix(file, "no cell of it was run");
  return other;
}

std::vector<HashRow> compare_hashes(const StressMatrix& matrix, const OtherHashes& other) {
  std::vector<HashRow> rows;
  for (std::size_t r = 0; r < matrix.cells.size(); ++r) {
    HashRow row;
    row.renderer = matrix.renderers[r].label;
    row.role = matrix.roles[r];
    for (const StressCell& cell : matrix.cells[r]) {
      const auto theirs = other.of_cell.find({row.renderer, cell.name});
      if (cell.status == CellStatus::kSkipped || theirs == other.of_cell.end()) continue;
      if (theirs->second == cell.trace_hash)
        ++row.same;
      else
        row.different.push_back(cell.name);
    }
    if (row.same + row.different.size() > 0) rows.push_back(std::move(row));
  }
  return rows;
}

Table hash_table(const std::vector<HashRow>& rows, const OtherHashes& other) {
  Table table;
  table.title = "Trace hashes against " + other.file;
  table.bad_means = "other bits than the other run's";
  table.columns = {"renderer", "the same", "different", "in"};
  for (const HashRow& row : rows)
    table.rows.push_back({{row.renderer},
                          {format_count(row.same)},
                          {format_count(row.different.size()), false, !row.different.empty()},
                          {row.different.empty() ? "" : fmt::format("{}", fmt::join(row.different, ", "))}});
  table.notes.push_back(fmt::format("The other run: {}. Cells that both ran.", other.built_by));
  return table;
}

std::string with_hashes(const std::string& stress_json, const std::vector<HashRow>& rows,
                        const OtherHashes& other) {
  DocumentJson json = DocumentJson::parse(stress_json);
  json["against"] = {
      {"file", other.file}, {"built_by", other.built_by}, {"renderers", DocumentJson::array()}};
  for (const HashRow& row : rows)
    json["against"]["renderers"].push_back(
        {{"renderer", row.renderer}, {"same", row.same}, {"different", row.different}});
  return document_text(json);
}

namespace {

// Known reasons for failed cells, inherent in a method.

struct Reason {
  std::string_view renderer, check, name;  ///< case or group; empty: any
  std::string_view text;
};

constexpr std::string_view kSinglePrecision =
    "Embree reads coordinates in single precision, here as the file has them: far from its origin they lose "
    "the mesh. frame=local, which is usual, keeps it";

constexpr std::string_view kBetweenCoarse =
    "Its size follows the gap that one in a hundred exceed: where a few points stand a hundred times as far "
    "apart as the rest it falls between them";
constexpr std::string_view kGraphWalk =
    "It walks from vertex to nearer vertex, and facets around the last one alone count: on thin and pointed "
    "bodies, and from afar, these are of another sheet";

constexpr std::array kReasons = {
    Reason{"penalty-grid", "free", "",
           "Its force begins at a threshold of distance in front of the points, by design"},
    Reason{"penalty-grid", "felt", "",
           "Its force ends at its threshold behind the points: it remembers no way in"},
    Reason{"mls-penalty", "free", "",
           "It knows no way in: where the fitted surface goes on beyond an open border, or turns its side, "
           "there is force"},
    Reason{"mls-penalty", "felt", "", "It knows no way in: out of reach of the points there is no force"},
    Reason{"vector-field", "felt", "",
           "Deeper than its band of voxels, and near sharp edges, there is no force: it knows no way in"},
    Reason{"vector-field", "free", "", "Its sides are those of a closed surface seen from outside"},
    Reason{"mls-proxy", "felt", "",
           "Its proxy moves by a bounded number of ticks a frame and tunnels where a HIP is fast or deep"},
    Reason{"mls-proxy", "free", "",
           "Past an open border, or inside a hollow body, its field still has a side"},
    Reason{
        "cloud-literal", "free", "",
        "Figure 42 as printed: the contact state has no side and sticks; boxes are of the worst resolution"},
    Reason{"cloud-literal", "twin", "",
           "Its 0.2 mm rule of shading (section 3.4) is a length that does not scale"},
    Reason{"cloud-literal", "felt", "", "Figure 42 as printed: contact is told by crossings of boxes alone"},
    Reason{"heightfield-literal", "twin", "", "Its 0.2 mm rule of shading is a length that does not scale"},
    Reason{"sphere-proxy", "felt", "", kBetweenCoarse},
    Reason{"stream-proxy", "felt", "", kBetweenCoarse},
    Reason{"variable-proxy", "felt", "", kBetweenCoarse},
    Reason{"sdf-godobject", "felt", "", kBetweenCoarse},
    Reason{"sdf-godobject", "free", "",
           "The sign of its field is that of the nearest points' planes: past an open border, at a tip and "
           "inside a hollow body it is not the side that the HIP came from"},
    Reason{"vgraph", "free", "", kGraphWalk},
    Reason{"vgraph", "felt", "", kGraphWalk},
    Reason{"mesh-proxy", "twin", "",
           "Which of several facets stops its sphere hangs on rounding in that frame"},
    Reason{"analytic", "bounded", "probe",
           "The truth looks for its way in by steps that are safe, up to the number that its bound states: "
           "from so far off it takes them all"},
    Reason{"mesh-godobject:frame=world", "twin", "offset", kSinglePrecision},
    Reason{"mesh-godobject:frame=world", "felt", "offset", kSinglePrecision},
    Reason{"mesh-godobject:frame=world", "free", "offset", kSinglePrecision},
};

bool matches(std::string_view pattern, std::string_view value) noexcept {
  return pattern.empty() || pattern == value;
}

}  // namespace

std::string known_reason(const RendererRequest& request, const StressCase& one, const StressCell& cell) {
  if (cell.status != CellStatus::kFailed) return {};
  const std::string text = spelled(request);
  for (const Reason& reason : kReasons)
    if ((reason.renderer == request.name || reason.renderer == text) && reason.check == cell.check &&
        (matches(reason.name, one.name) || matches(reason.name, one.group)))
      return std::string(reason.text) + ".";
  return {};
}

}  // namespace palpate::experiments
