// Making files of cells: every point once, halos, the same bytes always, and going on after a stop.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <limits>
#include <map>
#include <thread>

#include "tests/toolkit/prepared/prepared_points.h"
#include "toolkit/prepared/prepare_journal.h"

namespace palpate::prepared::test {
namespace {

/// Every point of the sheet is own point of one cell, off by half the cell's quantum per axis at most.
void expect_each_once(const CellFile& file, const Sheet& sheet) {
  std::map<std::size_t, Vec3> left;
  for (const Vec3& p : sheet.points) left.emplace(sheet.square(p), p);
  ASSERT_EQ(left.size(), sheet.points.size());
  ASSERT_EQ(file.info().points, sheet.points.size());
  // The lattice's cube and the rounding of large coordinates, beside the quantum.
  const double rounding = file.info().lattice.unit_mm() + sheet.corner.cwiseAbs().maxCoeff() * 4e-16;
  for (std::size_t cell = 0; cell < file.size(); ++cell) {
    const CellPoints points = palpate::test::value_of(file.read_cell(cell));
    EXPECT_LE(points.quantum_mm, file.info().quantum_mm);
    for (const Vec3& p : points.own_mm()) {
      EXPECT_TRUE(file.box_mm(cell).contains(p));
      const auto found = left.find(sheet.square(p));
      ASSERT_NE(found, left.end()) << "twice, or nobody's";
      EXPECT_LE((found->second - p).cwiseAbs().maxCoeff(), 0.5 * points.quantum_mm + rounding);
      left.erase(found);
    }
  }
  EXPECT_TRUE(left.empty());
}

TEST_F(Prepared, EveryPointIsFoundOnceWithinTheQuantum) {
  const struct {
    double step;
    Vec3 corner;
    double quantum;
  } kinds[] = {
      {0.3, {0.0, 0.0, 0.0}, 1.0},
      {300.0, {5e8, 5.4e9, 3e5}, 20.0},      // a terrain in mm, UTM
      {1e-3 / 200.0, {0.0, 0.0, 0.0}, 1.0},  // a micrometre wide
      {1e-3 / 200.0, {-7.0, 3.0, 2.0}, 1e-8},
      {1e6 / 200.0, {-5e5, -5e5, 0.0}, 1.0},  // a kilometre: cells are divided for the quantum
  };
  for (const auto& kind : kinds) {
    const Sheet sheet = Sheet::make(200, kind.step, kind.corner, 1);
    PrepareCellsOptions options;
    options.quantum_mm = kind.quantum;
    (void)prepare(sheet.points, options);
    const CellFile file = open();
    EXPECT_LE(file.info().quantum_mm, kind.quantum);
    EXPECT_GT(file.size(), sheet.points.size() / kMostCellPoints);
    expect_each_once(file, sheet);
  }
}

/// Brute force over all pairs of cell and point.
void expect_halos(const CellFile& file, const Sheet& sheet) {
  std::vector<CellPoints> cells(file.size());
  std::map<std::size_t, std::size_t> cell_of;
  for (std::size_t c = 0; c < file.size(); ++c) {
    cells[c] = palpate::test::value_of(file.read_cell(c));
    for (const Vec3& p : cells[c].own_mm()) cell_of[sheet.square(p)] = c;
  }
  std::size_t wide = 0;
  for (std::size_t c = 0; c < file.size(); ++c) {
    std::set<std::size_t> halo;
    for (std::size_t i = cells[c].own; i < cells[c].points_mm.size(); ++i)
      EXPECT_TRUE(halo.insert(sheet.square(cells[c].points_mm[i])).second);
    geometry::Aabb box;
    for (const Vec3& p : sheet.points)
      if (cell_of.at(sheet.square(p)) == c) box.add(p);
    const double distance = file.entry(c).halo_mm;
    // The maker measures between lattice points.
    const double slack = 4.0 * file.info().lattice.unit_mm();
    for (const Vec3& p : sheet.points) {
      const double d = std::sqrt(box.distance_sq_mm2(p));
      if (cell_of.at(sheet.square(p)) == c || std::abs(d - distance) <= slack) continue;
      ASSERT_EQ(halo.count(sheet.square(p)), d < distance ? 1u : 0u) << "cell " << c << ", " << d;
    }
    if (!halo.empty()) ++wide;
  }
  EXPECT_GT(wide, file.size() / 2) << "most cells have neighbours";
  EXPECT_GT(file.info().halo_points, file.info().points / 10);
}

TEST_F(Prepared, AHaloIsJustThePointsNearerThanItsDistance) {
  const Sheet sheet = Sheet::make(110, 0.3, {10.0, -20.0, 5.0}, 2);
  PrepareCellsOptions options;
  options.most_chunk_points = kMostCellPoints;  // seams of chunks everywhere
  const PrepareCellsReport report = prepare(sheet.points, options);
  EXPECT_GE(report.chunks, 2u);
  expect_halos(open(), sheet);
  // Small cells, whose halos reach over several others.
  options.quantum_mm = 1e-4;
  (void)prepare(sheet.points, options);
  const CellFile file = open();
  EXPECT_GT(file.size(), 40u);
  expect_halos(file, sheet);
}

TEST_F(Prepared, ADenseSurroundingGivesAThinnerHalo) {
  // A sparse sheet beside one of forty thousand points in a thousandth of the area.
  Random random(3);
  std::vector<Vec3> points;
  for (int i = 0; i < 5000; ++i)
    points.emplace_back(random.uniform(0.0, 100.0), random.uniform(0.0, 100.0), 0.0);
  for (int i = 0; i < 40000; ++i)
    points.emplace_back(random.uniform(100.5, 103.0), random.uniform(40.0, 43.0), 0.0);
  PrepareCellsOptions options;
  options.halo_spacings = 16.0;
  (void)prepare(points, options);
  const CellFile file = open();
  std::size_t limited = 0;
  for (std::size_t c = 0; c < file.size(); ++c) {
    ASSERT_LE(file.entry(c).halo, kMostHaloPoints);
    if (file.entry(c).halo < kMostHaloPoints * 9 / 10) continue;
    ++limited;
    EXPECT_GT(file.entry(c).halo_mm, 0.0);
  }
  EXPECT_GE(limited, 1u);
}

TEST_F(Prepared, TheBytesDependOnThePointsOnly) {
  const Sheet sheet = Sheet::make(300, 0.3, {5e5, 0.0, -4.0}, 4);
  PrepareCellsOptions options;
  options.quantum_mm = 1e-3;
  options.threads = 1;
  (void)prepare(sheet.points, options, "reference");
  const std::string reference = bytes("reference");
  ASSERT_GT(reference.size(), sheet.points.size() * kBytesPerPoint);
  options.threads = 2;
  (void)prepare(sheet.points, options);
  EXPECT_TRUE(bytes() == reference) << "two threads";
  for (const std::uint64_t most : {std::uint64_t{kMostCellPoints}, std::uint64_t{3 * kMostCellPoints}}) {
    options.most_chunk_points = most;
    const PrepareCellsReport report = prepare(sheet.points, options);
    EXPECT_GE(report.chunks, sheet.points.size() / most);
    EXPECT_TRUE(bytes() == reference) << "chunks of " << most;
  }
  options.memory_bytes = std::uint64_t{140} << 20;
  std::vector<Vec3> turned(sheet.points.rbegin(), sheet.points.rend());
  (void)prepare(turned, options);
  EXPECT_TRUE(bytes() == reference) << "another order, less memory";
  geometry::Aabb box;
  for (const Vec3& p : sheet.points) box.add(p);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const struct {
    geometry::Aabb bounds;
    int passes;
  } headers[] = {
      {box, 2}, {box.grown(1e5), 3}, {{box.low_mm, box.centre_mm()}, 3}, {{box.low_mm, {nan, 0, 0}}, 3}};
  options.most_chunk_points = kMostChunkPoints;
  for (const auto& header : headers) {
    MemoryStream stream(sheet.points);
    stream.changed_header().bounds = header.bounds;
    stream.changed_header().points = 7;
    const auto report = palpate::test::value_of(prepare_cells(stream, options, in("cells")));
    EXPECT_EQ(report.passes, header.passes) << "right bounds save a pass, wrong ones do no harm";
    EXPECT_TRUE(bytes() == reference);
  }
}

TEST_F(Prepared, FewEqualAndImpossiblePoints) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  PrepareCellsReport report = prepare({}, {});
  EXPECT_EQ(report.info.points, 0u);
  EXPECT_EQ(open().size(), 0u);
  report = prepare({{nan, 0, 0}, {0, inf, 0}, {0, 0, -1e300}}, {});
  EXPECT_EQ(report.info.dropped, 3u);
  EXPECT_EQ(open().info().dropped, 3u);
  report = prepare({{nan, 0, 0}, {1.5, -2.5, 1e9}}, {});
  const CellFile one = open();
  ASSERT_EQ(one.size(), 1u);
  EXPECT_EQ(one.info().dropped, 1u);
  const CellPoints read = palpate::test::value_of(one.read_cell(0));
  ASSERT_EQ(read.points_mm.size(), 1u);
  EXPECT_LE((read.points_mm[0] - Vec3(1.5, -2.5, 1e9)).norm(), 1e-6);

  PrepareCellsOptions options;
  options.most_chunk_points = kMostCellPoints;
  report = prepare(std::vector<Vec3>(50001, Vec3(5e8, 5.4e9, 3e5)), options);
  const CellFile equal = open();
  EXPECT_EQ(equal.size(), 13u);  // 50001 / 4096, upwards
  EXPECT_EQ(equal.info().halo_points, 0u) << "none is nearer than the others";
  options.most_chunk_points = kMostChunkPoints;
  const std::string reference = bytes();
  (void)prepare(std::vector<Vec3>(50001, Vec3(5e8, 5.4e9, 3e5)), options);
  EXPECT_TRUE(bytes() == reference);
}

TEST_F(Prepared, AnOutlierFarAwayCostsPassesOnly) {
  const Sheet sheet = Sheet::make(150, 0.3, Vec3::Zero(), 5);
  std::vector<Vec3> points = sheet.points;
  points.emplace_back(1e9, 1e9, 1e9);
  PrepareCellsOptions options;
  options.quantum_mm = 0.01;
  options.most_chunk_points = 2 * kMostCellPoints;
  const PrepareCellsReport report = prepare(points, options);
  EXPECT_GT(report.passes, 3);
  EXPECT_GT(report.chunks, 2u);
  const CellFile file = open();
  EXPECT_LE(file.info().quantum_mm, 0.01);
  std::uint64_t own = 0;
  for (std::size_t c = 0; c < file.size(); ++c) own += file.entry(c).points;
  EXPECT_EQ(own, points.size());
  // A micrometre is finer than 2^-42 of the whole.
  options.quantum_mm = 1e-5;
  MemoryStream stream(points);
  EXPECT_TRUE(
      palpate::test::refused(prepare_cells(stream, options, in("fine")), "cannot be stored", "far away"));
  EXPECT_FALSE(std::filesystem::exists(in("fine")));
  // One point in most cells: their table alone would not fit.
  options.quantum_mm = 3e-4;
  options.memory_bytes = std::uint64_t{140} << 20;
  std::vector<Vec3> many;
  Random random(9);
  for (int i = 0; i < 200000; ++i)
    many.emplace_back(random.uniform(0.0, 1e8), random.uniform(0.0, 1e8), random.uniform(0.0, 1e8));
  MemoryStream wide(many);
  EXPECT_TRUE(palpate::test::refused(prepare_cells(wide, options, in("fine")), "quantum", "cells"));
  EXPECT_FALSE(std::filesystem::exists(in("fine")));
}

struct Words final : Progress {
  std::vector<std::string> said;
  void report(std::string_view what, double) override { said.emplace_back(what); }
};

class StoppedPreparation : public Prepared {
 protected:
  StoppedPreparation() {
    sheet_ = Sheet::make(150, 0.3, Vec3::Zero(), 6);
    write("input", "stands for the file behind the stream");
    options_.threads = 1;        // no thread of another process
    options_.quantum_mm = 1e-4;  // several hundred cells, so that they are written in several pieces
    options_.most_chunk_points = kMostCellPoints;
    options_.input_path = in("input");
    (void)prepare(sheet_.points, options_, "reference");
    reference_ = bytes("reference");
  }
  /// True if it died.
  bool die_at(int report) {
    const pid_t child = ::fork();
    if (child == 0) {
      Death death(report);
      MemoryStream stream(sheet_.points);
      ::_exit(prepare_cells(stream, options_, in("cells"), death).ok() ? 0 : 1);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) != 1);
    return WEXITSTATUS(status) == 9;
  }
  /// The words of a run to the end.
  std::vector<std::string> finish(bool& resumed) {
    Words words;
    MemoryStream stream(sheet_.points);
    resumed = palpate::test::value_of(prepare_cells(stream, options_, in("cells"), words)).resumed;
    EXPECT_TRUE(bytes() == reference_);
    EXPECT_EQ(names(), (std::set<std::string>{"cells", "input", "reference"}));
    std::filesystem::remove(in("cells"));
    return words.said;
  }

  Sheet sheet_;
  PrepareCellsOptions options_;
  std::string reference_;
};

TEST_F(StoppedPreparation, GoesOnWhereItDied) {
  std::set<std::size_t> lengths;
  int report = 1;
  for (; die_at(report); ++report) {
    EXPECT_FALSE(std::filesystem::exists(in("cells"))) << "nothing, or a whole file";
    bool resumed = false;
    const std::vector<std::string> said = finish(resumed);
    EXPECT_EQ(resumed, said.front() != "counting points");
    lengths.insert(said.size());
  }
  EXPECT_GT(report, 10) << "a few passes, chunks and pieces";
  // All deaths in the three passes leave the same work; later ones ever less.
  EXPECT_GE(lengths.size() + 3, static_cast<std::size_t>(report) - 1);
}

TEST_F(StoppedPreparation, GoesOnAfterAKillAtAnyMoment) {
  // A millisecond longer each time, so that the kills fall into all parts of the work.
  constexpr int kKills = 40;
  for (int kill = 0; kill < kKills; ++kill) {
    const pid_t child = ::fork();
    if (child == 0) {
      MemoryStream stream(sheet_.points);
      ::_exit(prepare_cells(stream, options_, in("cells")).ok() ? 0 : 1);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(kill));
    ::kill(child, SIGKILL);
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_FALSE(WIFEXITED(status) && WEXITSTATUS(status) == 1);
    if (!std::filesystem::exists(in("cells"))) continue;
    EXPECT_TRUE(bytes() == reference_) << "nothing, or a whole file";
    std::filesystem::remove(in("cells"));
  }
  bool resumed = false;
  (void)finish(resumed);
}

TEST_F(StoppedPreparation, AJournalTornInItsLastRecordLosesThatStepOnly) {
  int report = 1;
  for (; die_at(report); ++report) {
    constexpr std::size_t kTorn = 5;
    const std::string journal = bytes("cells.journal");
    write("cells.journal", journal.substr(0, journal.size() - kTorn));
    bool resumed = false;
    const std::vector<std::string> said = finish(resumed);
    EXPECT_EQ(resumed, said.front() != "counting points");
  }
  EXPECT_GT(report, 10);
  std::filesystem::remove(in("cells"));
  // The last report is of writing: cells that another run has written over are written again.
  ASSERT_TRUE(die_at(report - 1));
  write("cells.part", std::string(bytes("cells.part").size(), 'x'));
  bool resumed = false;
  EXPECT_EQ(finish(resumed).front(), "writing cells");
}

TEST_F(StoppedPreparation, AChangedInputOrScratchBeginsAgain) {
  constexpr int kWhileSorting = 5;  // two reports of counting, one of scattering
  ASSERT_TRUE(die_at(kWhileSorting));
  std::filesystem::last_write_time(in("input"),
                                   std::filesystem::last_write_time(in("input")) + std::chrono::seconds(1));
  bool resumed = true;
  EXPECT_EQ(finish(resumed).front(), "counting points");
  EXPECT_FALSE(resumed);
  ASSERT_TRUE(die_at(kWhileSorting));
  write("cells.scratch", "cut short");
  EXPECT_EQ(finish(resumed).front(), "counting points");
  ASSERT_TRUE(die_at(kWhileSorting));
  options_.quantum_mm *= 2.0;
  MemoryStream stream(sheet_.points);
  const auto report = palpate::test::value_of(prepare_cells(stream, options_, in("cells")));
  EXPECT_FALSE(report.resumed) << "other options";
}

TEST_F(Prepared, AFolderIsKnownByItsFiles) {
  std::filesystem::create_directory(in("tiles"));
  write("tiles/a", "a tile");
  const JournalKey one = make_journal_key(in("tiles"), 0);
  EXPECT_FALSE(one.unknown);
  EXPECT_EQ(make_journal_key(in("tiles"), 0), one);
  write("tiles/b", "another");
  const JournalKey two = make_journal_key(in("tiles"), 0);
  EXPECT_FALSE(two == one);
  write("tiles/b", "another, longer");
  EXPECT_FALSE(make_journal_key(in("tiles"), 0) == two);
  EXPECT_TRUE(make_journal_key(in("no tiles"), 0).unknown);
}

TEST_F(Prepared, StoppedOrRefusedLeavesNothing) {
  struct Stop final : Progress {
    bool asked = false;
    void report(std::string_view what, double) override { asked = what == "sorting points"; }
    bool cancelled() const override { return asked; }
  } stop;
  MemoryStream stream(Sheet::make(150, 0.3, Vec3::Zero(), 7).points);
  PrepareCellsOptions options;
  options.most_chunk_points = kMostCellPoints;
  EXPECT_TRUE(palpate::test::refused(prepare_cells(stream, options, in("cells"), stop), "stopped"));
  EXPECT_TRUE(names().empty());
  options.memory_bytes = 1;
  EXPECT_TRUE(palpate::test::refused(prepare_cells(stream, options, in("cells")), "memory"));
  options = {};
  options.quantum_mm = 0.0;
  EXPECT_TRUE(palpate::test::refused(prepare_cells(stream, options, in("cells")), "quantum"));
  options = {};
  options.mm_per_unit = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(palpate::test::refused(prepare_cells(stream, options, in("cells")), "unit"));
  EXPECT_TRUE(palpate::test::refused(prepare_cells(stream, {}, in("nowhere/cells")), "create the folder"));
  EXPECT_TRUE(names().empty());
}

TEST_F(Prepared, PointsThatChangeBetweenPassesAreRefused) {
  struct Shrinking final : MemoryStream {
    using MemoryStream::MemoryStream;
    int whole_passes = 1;
    Status rewind() override {
      if (--whole_passes == 0) points_.pop_back();
      return MemoryStream::rewind();
    }
  };
  // Without bounds in the header: bounds, counts, scattering.
  for (const int passes : {1, 2}) {
    Shrinking stream(Sheet::make(60, 0.3, Vec3::Zero(), 8).points);
    stream.whole_passes = passes;
    EXPECT_TRUE(palpate::test::refused(prepare_cells(stream, {}, in("cells")), "other points"));
    EXPECT_TRUE(names().empty());
  }
}

}  // namespace
}  // namespace palpate::prepared::test
