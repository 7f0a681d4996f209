// What tables say, and that they fit: a terminal of any width, a page, many renderers.

#include <cmath>
#include <limits>

#include "experiments/report/page.h"
#include "experiments/report/tables.h"
#include "experiments/session/session.h"
#include "tests/experiments/program.h"
#include "toolkit/core/random.h"

namespace palpate::experiments {
namespace {

/// A renderer with every score, from timings made up of `ns` a frame.
metrics::RendererResult renderer(const std::string& label, std::int64_t ns, double error_n) {
  metrics::RendererResult r;
  r.label = r.name = label;
  r.model = metrics::RendererResult::Model{1'002'001, 0.1};
  r.prepare = render::PrepareReport{};
  r.prepare->total_ms = static_cast<double>(ns);
  r.prepare->bytes = 64'000'000;
  r.frame = trace::frame_statistics({ns, 2 * ns, 3 * ns}, std::vector<trace::RunTime>{{5 * ns, 3}}, 40.0);
  r.frame->frames = 50'000;
  r.frame->contact_frames = r.frame->timed_frames = 38'123;
  metrics::Accuracy a;
  a.floor_n = 0.0275;
  a.rounding_n = 1.5e-6;
  a.rounding_mm = 3e-6;
  a.force_rms_n = error_n;
  a.force_rms_percent = 100.0 * error_n;
  a.force_max_n = 2.0 * error_n;
  a.within_7_percent = 99.0;
  a.direction_p99_deg = 10.0 * error_n;
  a.excess_jump_max_n = error_n;
  a.pop_throughs = 0;
  a.god_object_rms_mm = 2.0 * error_n;
  a.god_object_max_mm = 3.0 * error_n;
  a.onset_error_mm = a.release_error_mm = 0.05;
  r.accuracy = a;
  r.energy = metrics::Energy{error_n, error_n, 1.0, 0.0, 1e-9, {}, {}};
  return r;
}

metrics::ResultDocument study_of(std::size_t renderers) {
  metrics::ResultDocument d;
  for (std::size_t i = 0; i < renderers; ++i)
    d.renderers.push_back(renderer("mesh-godobject-number-" + std::to_string(i + 1),
                                   100 + 31 * static_cast<std::int64_t>(i),
                                   0.01 * static_cast<double>(i + 1)));
  return d;
}

const std::vector<Cell>& row_of(const Table& table, const std::string& name) {
  for (const auto& row : table.rows)
    if (row.size() > 1 && row[0].text == name) return row;
  ADD_FAILURE() << "no row '" << name << "'";
  return table.rows.front();
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines(1);
  for (const char c : text) {
    if (c == '\n')
      lines.emplace_back();
    else
      lines.back() += c;
  }
  return lines;
}

TEST(TableText, FitsEveryTerminal) {
  for (const std::size_t renderers : {1u, 2u, 9u, 14u})
    for (const std::size_t columns : {60u, 80u, 120u, 200u}) {
      const Table table = comparison_table(study_of(renderers));
      const std::string text = to_text(table, columns);
      for (const std::string& line : lines_of(text))
        EXPECT_LE(text_width(line), columns) << renderers << " renderers, " << columns << ": " << line;
      // Every cell is there, turned or not.
      for (const auto& row : table.rows)
        for (std::size_t i = 1; i < row.size(); ++i)
          EXPECT_THAT(text, HasSubstr(row[i].text)) << row[0].text << " " << row[i].text;
      EXPECT_GE(count_of(text, "number-" + std::to_string(renderers)), 1u) << text;
    }
}

TEST(TableText, GoesOnBelowWhereItCannotBeTurned) {
  Table table;
  table.columns = {"model"};
  table.rows = {{{"sinusoid", false, false}}};
  for (int i = 0; i < 12; ++i) {
    table.columns.push_back("value number " + std::to_string(i));
    table.rows[0].push_back({std::to_string(1'000'000 + i), false, false});
  }
  const std::string text = to_text(table, 50);
  for (const std::string& line : lines_of(text)) EXPECT_LE(text_width(line), 50u) << line;
  for (int i = 0; i < 12; ++i) EXPECT_THAT(text, HasSubstr(std::to_string(1'000'000 + i)));
  EXPECT_GT(count_of(text, "sinusoid"), 1u) << "each part says what its rows are\n" << text;
}

TEST(TableText, LongTextsAreWrappedInTheirColumn) {
  Table table;
  table.columns = {"renderer", "what it does"};
  table.rows = {{{"cloud", false, false},
                 {"walks from point to point with a god object that never leaves the surface of the cloud",
                  false, false}}};
  const std::vector<std::string> lines = lines_of(to_text(table, 40));
  ASSERT_GE(lines.size(), 4u);
  const std::size_t column = lines[0].find("what it does");
  EXPECT_EQ(lines[1].find("walks"), column) << "words stand left, under their heading";
  for (const std::string& line : lines) EXPECT_LE(text_width(line), 40u);
}

TEST(TableText, DecimalsStandUnderEachOtherWithAndWithoutAMark) {
  Table table;
  table.columns = {"", "µs"};
  table.rows = {{{"a", false, false}, {"1.50", false, false}}, {{"b", false, false}, {"0.25", true, false}}};
  const std::vector<std::string> lines = lines_of(to_text(table, 80));
  EXPECT_EQ(lines[1].find('.'), lines[2].find('.')) << lines[1] << "\n" << lines[2];
  EXPECT_EQ(lines[2].back(), '*');
}

TEST(Wrapped, BreaksAtBlanksAndAfterHyphens) {
  using Lines = std::vector<std::string>;
  EXPECT_EQ(wrapped("mesh-godobject", 9), (Lines{"mesh-", "godobject"}));
  EXPECT_EQ(wrapped("mesh-godobject", 14), (Lines{"mesh-godobject"}));
  EXPECT_EQ(wrapped("force error, RMS, N", 12), (Lines{"force error,", "RMS, N"}));
  EXPECT_EQ(wrapped("from -5 to 1e-3", 4), (Lines{"from", "-5", "to", "1e-3"}));
  EXPECT_EQ(wrapped("", 10), Lines{""});
  EXPECT_EQ(wrapped("µµµµ µµµµ", 9), (Lines{"µµµµ µµµµ"})) << "letters are counted, not bytes";
}

TEST(Legend, ExplainsTheMarksThatAreThere) {
  const Table table = comparison_table(study_of(2));
  ASSERT_TRUE(row_of(table, "mean, µs")[1].best);
  const std::string text = to_text(table, 100);
  EXPECT_THAT(text, HasSubstr("* the best of its row"));
  EXPECT_THAT(text, Not(HasSubstr("! ")));
  EXPECT_THAT(to_html(table), HasSubstr("<span>* the best of its row</span>"));
  // A turned table says column.
  const Table many = comparison_table(study_of(12));
  EXPECT_THAT(to_text(many, 80), HasSubstr("* the best of its column"));
  EXPECT_THAT(to_html(many), HasSubstr("<span>* the best of its column</span>"));
  // Nothing marked, nothing said.
  EXPECT_EQ(to_text(comparison_table(study_of(1)), 80).find('*'), std::string::npos);
  // What is missing is a dash with a word for it; what failed is marked.
  metrics::ResultDocument d = study_of(2);
  d.renderers[1].status = metrics::RunStatus::kFailed;
  d.renderers[1].frame.reset();
  d.renderers[0].accuracy->force_max_n = std::numeric_limits<double>::quiet_NaN();
  const std::string failed = to_text(comparison_table(d), 100);
  EXPECT_THAT(failed, HasAll("– no value", "! did not run to its end"));
  EXPECT_THAT(failed, Not(HasSubstr("nan")));
}

TEST(ComparisonTable, AMeanIsNeverAboveTheLongestBesideIt) {
  constexpr std::uint64_t kSeed = 11;
  SCOPED_TRACE(kSeed);
  Random random(kSeed);
  for (int trial = 0; trial < 300; ++trial) {
    metrics::ResultDocument d = study_of(2);
    for (metrics::RendererResult& r : d.renderers) {
      std::vector<std::int64_t> frames(1 + random.below(5));
      std::vector<trace::RunTime> runs(1 + random.below(3));
      for (std::int64_t& ns : frames) ns = static_cast<std::int64_t>(random.below(2000));
      for (trace::RunTime& run : runs)  // interrupted now and then, in that pass alone
        run = {static_cast<std::int64_t>(random.below(random.below(4) == 0 ? 9'000'000 : 5000)),
               1 + random.below(4)};
      r.frame = trace::frame_statistics(frames, runs, 40.0);
    }
    const Table table = comparison_table(d);
    // What the text stands for: from half a unit of its last place below to as much above.
    const auto range = [&](const char* row, std::size_t i) {
      std::string text = row_of(table, row)[i].text;
      std::erase(text, ',');
      EXPECT_THAT(text, Not(HasSubstr("×10")));
      const bool less = text.starts_with("<");
      if (less) text.erase(0, 1);
      const std::size_t point = text.find('.');
      const double half =
          0.5 *
          std::pow(10.0, point == std::string::npos ? 0.0 : -static_cast<double>(text.size() - point - 1));
      return less ? std::pair(0.0, std::stod(text))
                  : std::pair(std::stod(text) - half, std::stod(text) + half);
    };
    for (const std::size_t i : {1u, 2u})
      for (const char* mean : {"mean, µs", "mean without the clock, µs"})
        EXPECT_LE(range(mean, i).first, range("longest, µs", i).second) << to_text(table, 120);
  }
}

TEST(ComparisonTable, SaysHowManyFramesAreInContact) {
  metrics::ResultDocument d = study_of(2);
  EXPECT_EQ(row_of(comparison_table(d), "frames in contact, of 50,000")[1].text, "38,123");
  d.renderers[1].frame->frames = 20'000;
  const Table table = comparison_table(d);
  EXPECT_EQ(row_of(table, "frames in contact")[2].text, "38,123");
  EXPECT_EQ(row_of(table, "frames in all")[2].text, "20,000");
}

TEST(ComparisonTable, RoundingIsNoError) {
  metrics::ResultDocument d = study_of(0);
  d.renderers = {renderer("mesh-godobject", 100, 6.18e-16), renderer("cloud", 200, 0.02)};
  const std::string text = to_text(comparison_table(d), 100);
  for (const char* row :
       {"force error, RMS, N", "force error, RMS, %", "god object error, RMS, mm", "energy generated, %"})
    EXPECT_EQ(row_of(comparison_table(d), row)[1].text, "0") << row;
  EXPECT_THAT(text, Not(HasSubstr("0000000")));
  EXPECT_THAT(text, HasSubstr("0 also where it is no more than the rounding"));
  std::string found;
  for (const Headline& line : headlines_of(d)) found += line.lead + ": " + line.text + "\n";
  EXPECT_THAT(found, HasSubstr("Force error, RMS: mesh-godobject exact, cloud 2.00 %\n"));
  // Both exact: neither is the better one. A real error is none of that.
  d.renderers[1] = renderer("cloud", 200, 3e-16);
  EXPECT_FALSE(row_of(comparison_table(d), "force error, RMS, N")[2].best);
  d.renderers[1] = renderer("cloud", 200, 4e-6);
  EXPECT_EQ(row_of(comparison_table(d), "force error, RMS, N")[2].text, "4.00×10⁻⁶");
}

TEST(ComparisonTable, WhatReadsTheSameIsAsGood) {
  metrics::ResultDocument d = study_of(3);
  d.renderers[0].accuracy->god_object_rms_mm = 0.038101;
  d.renderers[1].accuracy->god_object_rms_mm = 0.038099;
  d.renderers[2].accuracy->god_object_rms_mm = 1153.0;
  Table table = comparison_table(d);
  const auto& row = row_of(table, "god object error, RMS, mm");
  EXPECT_EQ(row[1].text, row[2].text);
  EXPECT_TRUE(row[1].best && row[2].best) << "no mark tells apart what reads the same";
  EXPECT_FALSE(row[3].best);
  d.renderers[2].accuracy->god_object_rms_mm = 0.0381;
  table = comparison_table(d);
  for (const Cell& cell : row_of(table, "god object error, RMS, mm")) EXPECT_FALSE(cell.best);
}

TEST(ComparisonTable, WhatIsNotFiniteWinsNothing) {
  metrics::ResultDocument d = study_of(3);
  for (const std::size_t bad : {0u, 2u}) {
    d.renderers[bad].accuracy->force_rms_n = std::numeric_limits<double>::quiet_NaN();
    const Table table = comparison_table(d);
    EXPECT_EQ(row_of(table, "force error, RMS, N")[bad + 1].text, kMissingNumber);
    EXPECT_FALSE(row_of(table, "force error, RMS, N")[bad + 1].best);
  }
  EXPECT_TRUE(row_of(comparison_table(study_of(3)), "force error, RMS, N")[1].best);
}

TEST(Headlines, OfManyNameTheFirstAndTheLast) {
  std::string all;
  for (const Headline& line : headlines_of(study_of(14)))
    if (line.lead == "Force error, RMS") all = line.text;
  EXPECT_EQ(count_of(all, "number-"), 6u) << all;
  EXPECT_THAT(all, HasSubstr("9 more up to mesh-godobject-number-14 14.0 % (14.0 times)"));
}

TEST(TableHtml, ManyRenderersBecomeRows) {
  const std::string few = to_html(comparison_table(study_of(2)));
  EXPECT_EQ(count_of(few, "<table"), 1u);
  const Table table = comparison_table(study_of(9));
  const std::string many = to_html(table);
  EXPECT_GT(count_of(many, "<table"), 3u) << "a table a group";
  EXPECT_EQ(count_of(many, "<th scope=\"row\">mesh-godobject-number-9</th>"), count_of(many, "<table"));
  constexpr std::size_t kOnPaper = 9;
  for (const Table& group : turned(table)) {
    EXPECT_LE(group.columns.size(), kOnPaper) << group.title << ": too wide for a sheet of A4";
    for (const auto& row : group.rows) EXPECT_EQ(row.size(), group.columns.size());
  }
  // Turning loses nothing.
  std::size_t cells = 0, kept = 0;
  for (const auto& row : table.rows) cells += row.size() - 1;
  for (const Table& group : turned(table))
    for (const auto& row : group.rows) kept += row.size() - 1;
  EXPECT_EQ(kept, cells);
}

TEST(Terminal, WidthIsWhatTheEnvironmentSays) {
  const auto columns_if = [](const char* said) {
    const Environment columns("COLUMNS", said);
    return terminal_columns(-1);
  };
  EXPECT_EQ(columns_if("132"), 132u);
  for (const char* wrong : {"", "0", "-5", "wide", "80x", "99999999999999999999"})
    EXPECT_EQ(columns_if(wrong), 80u) << wrong;
  EXPECT_EQ(columns_if(nullptr), 80u) << "no terminal";
}

}  // namespace
}  // namespace palpate::experiments
