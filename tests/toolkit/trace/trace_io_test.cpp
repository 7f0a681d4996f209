// Paths and traces as text: bits survive, every mistake is told with its line.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <filesystem>
#include <string>

#include <palpate/trace.h>
#include "tests/files.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/random.h"

namespace palpate::trace {
namespace {

class TraceIo : public InFolder {
 protected:
  [[nodiscard]] std::string holding(const std::string& text, const std::string& name = "a.csv") const {
    write_text(in(name), text);
    return in(name);
  }
};

ProbePath two_rows() {
  ProbePath path;
  path.t_s = {0, 0.001};
  path.hip_mm = {{1, 2, 3}, {0.1, -2e-7, 1e22}};
  return path;
}

TEST_F(TraceIo, PathIsWrittenWithTheFewestDigits) {
  ASSERT_TRUE(write_path_csv(two_rows(), in("p.csv")));
  EXPECT_EQ(file_text(in("p.csv")), "t_s,x_mm,y_mm,z_mm\n0,1,2,3\n0.001,0.1,-2e-07,1e+22\n");
  EXPECT_FALSE(std::filesystem::exists(in("p.csv.part")));
}

TEST_F(TraceIo, EveryBitSurvives) {
  Random random(7);
  ProbePath path;
  double t = 0;
  for (int i = 0; i < 2000; ++i) {
    Vec3 p;
    for (int axis = 0; axis < 3; ++axis) {
      do {
        p[axis] = std::bit_cast<double>(random.next());
      } while (!std::isfinite(p[axis]));
    }
    path.hip_mm.push_back(p);
    path.t_s.push_back(t += random.uniform(1e-9, 1.0));
  }
  ASSERT_TRUE(write_path_csv(path, in("p.csv")));
  const auto back = test::value_of(read_path_csv(in("p.csv")));
  EXPECT_EQ(back.t_s, path.t_s);
  EXPECT_EQ(back.hip_mm, path.hip_mm);
  EXPECT_EQ(back.name, in("p.csv"));
}

TEST_F(TraceIo, TheTruthGoesOutAndComesBack) {
  const ProbePath path = two_rows();
  ReferenceTrace reference;
  reference.frames.resize(2);
  reference.frames[0] = {
      {{0, 0, 0}, path.hip_mm[0], false, -1, render::FrameStatus::kOk}, {0, 0, 1}, 0.3, 0.1};
  reference.frames[1] = {
      {{0, 0.25, -1}, {4, 5, 6}, true, 0, render::FrameStatus::kOk}, {0.6, 0, 0.8}, -1.0 / 3.0, 0.2};
  ASSERT_TRUE(write_reference_csv(path, reference, in("r.csv")));
  const std::string text = file_text(in("r.csv"));
  EXPECT_TRUE(text.starts_with(std::string(kReferenceHeader) + "\n0,1,2,3,0,0,0,0,1,2,3,0,0,1,0.3,0.1\n"))
      << text;
  const auto back = test::value_of(read_reference_csv(in("r.csv")));
  EXPECT_EQ(back.path.hip_mm, path.hip_mm);
  for (std::size_t i = 0; i < 2; ++i) {
    const TruthFrame &a = back.reference.frames[i], &b = reference.frames[i];
    EXPECT_EQ(a.frame.force_n, b.frame.force_n);
    EXPECT_EQ(a.frame.god_object_mm, b.frame.god_object_mm);
    EXPECT_EQ(a.frame.contact, b.frame.contact);
    EXPECT_EQ(a.normal, b.normal);
    EXPECT_EQ(a.signed_distance_mm, b.signed_distance_mm);
    EXPECT_EQ(a.local_resolution_mm, b.local_resolution_mm);
  }
  const std::string head = std::string(kReferenceHeader) + "\n";
  const auto bad = read_reference_csv(holding(head + "0,1,2,3,0,0,0,2,1,2,3,0,0,1,0.3,0.1\n"));
  ASSERT_FALSE(bad);
  EXPECT_EQ(bad.error().line, 2) << bad.error().message();
  EXPECT_FALSE(read_reference_csv(holding(head + "0,1,2,3,0,0,0,1,1,2,3,0,0,1,0.3\n"))) << "a field less";
  EXPECT_FALSE(read_reference_csv(holding(head))) << "no row";
  // What was compared with a second reference says so in a column of its own.
  EXPECT_FALSE(back.reference.compared);
  reference.compared = true;
  reference.frames[1].history_decides = true;
  ASSERT_TRUE(write_reference_csv(path, reference, in("h.csv")));
  const auto compared = test::value_of(read_reference_csv(in("h.csv")));
  EXPECT_TRUE(compared.reference.compared);
  EXPECT_FALSE(compared.reference.frames[0].history_decides);
  EXPECT_TRUE(compared.reference.frames[1].history_decides);
  const std::string longer = std::string(kComparedReferenceHeader) + "\n";
  EXPECT_FALSE(read_reference_csv(holding(longer + "0,1,2,3,0,0,0,1,1,2,3,0,0,1,0.3,0.1,2\n")));
  EXPECT_FALSE(read_reference_csv(holding(longer + "0,1,2,3,0,0,0,1,1,2,3,0,0,1,0.3,0.1\n")))
      << "a field less";
  reference.frames.pop_back();
  EXPECT_FALSE(write_reference_csv(path, reference, in("r.csv")));
}

TEST_F(TraceIo, TraceGoesOutAndComesBack) {
  const ProbePath path = two_rows();
  ForceTrace trace;
  trace.frames.resize(2);
  trace.frames[0].god_object_mm = path.hip_mm[0];
  trace.frames[1] = {{0, 0.25, -1}, {4, 5, 6}, true, 0, render::FrameStatus::kOk};
  trace.frame_ns = {90, 123456789012};
  ASSERT_TRUE(write_trace_csv(path, trace, in("t.csv")));
  EXPECT_EQ(file_text(in("t.csv")),
            "t_s,x_mm,y_mm,z_mm,fx_n,fy_n,fz_n,contact,gx_mm,gy_mm,gz_mm,frame_ns\n"
            "0,1,2,3,0,0,0,0,1,2,3,90\n0.001,0.1,-2e-07,1e+22,0,0.25,-1,1,4,5,6,123456789012\n");
  const auto back = test::value_of(read_trace_csv(in("t.csv")));
  EXPECT_EQ(trace_hash(back.trace), trace_hash(trace));
  EXPECT_EQ(back.trace.frame_ns, trace.frame_ns);
  EXPECT_EQ(back.path.hip_mm, path.hip_mm);
  EXPECT_EQ(back.trace.frames[0].model, -1);
  trace.frame_ns.clear();
  ASSERT_TRUE(write_trace_csv(path, trace, in("t.csv")));
  EXPECT_EQ(read_trace_csv(in("t.csv"))->trace.frame_ns[1], 0);
  trace.frames.pop_back();
  EXPECT_FALSE(write_trace_csv(path, trace, in("t.csv")));
}

TEST_F(TraceIo, AWriteThatFailsLeavesNothing) {
  const Status status = write_path_csv(two_rows(), in("no/such/folder/p.csv"));
  ASSERT_TRUE(test::refused(status, "no/such/folder/p.csv"));
  EXPECT_FALSE(status.error().remedy.empty());
}

TEST_F(TraceIo, LineEndsOfOtherSystemsAndAMissingLastOne) {
  const auto path = test::value_of(read_path_csv(holding("t_s,x_mm,y_mm,z_mm\r\n0,1,2,3\r\n1,+1,2e0,3.5")));
  EXPECT_EQ(path.hip_mm[1], Vec3(1, 2, 3.5));
}

TEST_F(TraceIo, BlankLinesAndAByteOrderMarkArePassedOver) {
  const std::string rows = "\r\n0,1,2,3\r\n \t\n1,4,5,6\n\n\n";
  const auto path = test::value_of(read_path_csv(holding("\xEF\xBB\xBF\nt_s,x_mm,y_mm,z_mm\r\n" + rows)));
  EXPECT_EQ(path.t_s, (std::vector<double>{0, 1}));
  EXPECT_EQ(path.hip_mm[1], Vec3(4, 5, 6));
  // Lines are counted as they stand in the file.
  const auto bad = read_path_csv(holding("\n\nt_s,x_mm,y_mm,z_mm\n\n0,1,2\n"));
  ASSERT_FALSE(bad);
  EXPECT_EQ(bad.error().line, 5);
  const auto traj = test::value_of(read_traj(holding("\xEF\xBB\xBF"
                                                     "0 1 2 3\n\n1 4 5 6\n",
                                                     "a.traj"),
                                             {}));
  EXPECT_EQ(traj.path.hip_mm[0], Vec3(1, 2, 3));
  const std::string utf16("\xFF\xFEt\0_\0s\0\n\0", 10);
  for (const Error& error : {read_path_csv(holding(utf16)).error(), read_trace_csv(in("a.csv")).error(),
                             read_traj(in("a.csv"), {}).error()}) {
    EXPECT_EQ(error.line, 1);
    EXPECT_TRUE(test::contains(error.message(), "UTF-16"));
    EXPECT_TRUE(test::contains(error.remedy, "UTF-8")) << error.message();
  }
}

TEST_F(TraceIo, LongFilesAreReadPieceByPiece) {
  // Lines that end anywhere in the reader's buffer, comments as long as it allows.
  Random random(3);
  std::string text;
  std::size_t rows = 0;
  while (text.size() < 300'000) {
    text += "# " + std::string(static_cast<std::size_t>(random.uniform(0.0, 4000.0)), '-') + "\n";
    text += std::to_string(rows++) + " 1 2 3\n";
  }
  text.pop_back();
  const auto read = test::value_of(read_traj(holding(text, "long.traj"), {}));
  ASSERT_EQ(read.path.size(), rows);
  EXPECT_EQ(read.path.t_s.back(), static_cast<double>(rows - 1));
}

TEST_F(TraceIo, MemoryHasABoundWithAnOption) {
  std::string text = "t_s,x_mm,y_mm,z_mm\n";
  for (int i = 0; i < 1000; ++i) text += std::to_string(i) + ",0,0,0\n";
  EXPECT_TRUE(read_path_csv(holding(text), 32'000));
  const auto refused = read_path_csv(holding(text), 31'999);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().line, 1001);
  EXPECT_TRUE(test::contains(refused.error().message(), "--memory-limit-gb"));
}

TEST_F(TraceIo, EveryMistakeIsToldWithItsLine) {
  const std::string head = "t_s,x_mm,y_mm,z_mm\n";
  const struct {
    std::string text;
    std::int64_t line;
    std::string says;
  } cases[] = {
      {"", 0, "empty"},
      {"x,y,z\n0,1,2,3\n", 1, "header"},
      {"\x1f\x8b\x08 and so on", 0, "compressed"},
      {"\xfd"
       "7zXZ and so on" +
           std::string(10000, '3'),
       0, "compressed"},
      {"t_s,x_mm,y_mm,z_mm,f\n0,1,2,3,4\n", 1, "header"},
      {head, 1, "no row"},
      {head + "0,1,2\n", 2, "3 fields instead of 4"},
      {head + "0,1,2,3,4\n", 2, "more than 4"},
      {head + "0,1,2,3\n,\n", 3, "not a finite number"},
      {head + "\n \n", 3, "no row"},
      {head + "0,1,2,3\n1,a,2,3\n", 3, "'a' is not a finite number"},
      {head + "0,1,2, 3\n", 2, "' 3' is not"},
      {head + "0,1,nan,3\n", 2, "finite"},
      {head + "0,inf,2,3\n", 2, "finite"},
      {head + "0,1e999,2,3\n", 2, "finite"},
      {head + "0,1,2,3\n0,1,2,3\n", 3, "time goes from 0 s to 0 s"},
      {head + "0,1,2,3\n1,1,2,3\n0.5,1,2,3\n", 4, "time goes from 1 s to 0.5 s"},
      {head + "0,1,2," + std::string(10000, '3') + "\n", 2, "longer than"},
      {head + std::string("0,1,2,3\0\n", 9), 2, "'3?' is not"},
  };
  for (const auto& c : cases) {
    const auto path = read_path_csv(holding(c.text));
    ASSERT_FALSE(path) << c.text.substr(0, 60);
    EXPECT_EQ(path.error().line, c.line) << c.text.substr(0, 60);
    EXPECT_TRUE(test::contains(path.error().what, c.says)) << path.error().message();
    EXPECT_FALSE(path.error().remedy.empty()) << path.error().message();
    EXPECT_EQ(path.error().file, in("a.csv"));
  }
  EXPECT_FALSE(read_path_csv(in("not there")));
  EXPECT_FALSE(read_path_csv(folder_.string())) << "a folder";
}

TEST_F(TraceIo, TraceMistakes) {
  const std::string head = std::string(kTraceHeader) + "\n";
  EXPECT_FALSE(read_trace_csv(holding(head + "0,1,2,3,0,0,0,2,1,2,3,90\n"))) << "contact 2";
  EXPECT_FALSE(read_trace_csv(holding(head + "0,1,2,3,0,0,0,1,1,2,3,1e300\n"))) << "time out of range";
  EXPECT_FALSE(read_trace_csv(holding(head + "0,1,2,3,0,0,0,1,1,2,3\n")));
}

TEST_F(TraceIo, TrajColumnsAreFreeToChoose) {
  const std::string text =
      "# a comment\n\n  10  1.5 2 3   0.1 0.2 0.3 \n% another\n11 4 5 6 7 8 9\n12\t4  5 6\t7 8 9\n";
  TrajColumns columns;
  columns.fx = 4;
  columns.fy = 5;
  columns.fz = 6;
  columns.mm_per_unit = 1000;
  columns.s_per_unit = 0.5;
  const auto read = test::value_of(read_traj(holding(text, "probe.traj"), columns));
  EXPECT_EQ(read.path.t_s, (std::vector<double>{5, 5.5, 6}));
  EXPECT_EQ(read.path.hip_mm[0], Vec3(1500, 2000, 3000));
  EXPECT_EQ(read.force_n[1], Vec3(7, 8, 9));

  TrajColumns bare;
  bare.t = -1;
  bare.x = 2;
  bare.y = 1;
  bare.z = 0;
  bare.sample_rate_hz = 100;
  const auto swapped = test::value_of(read_traj(in("probe.traj"), bare));
  EXPECT_EQ(swapped.path.t_s[2], 0.02);
  EXPECT_EQ(swapped.path.hip_mm[0], Vec3(2, 1.5, 10));
  EXPECT_TRUE(swapped.force_n.empty());
}

TEST_F(TraceIo, TrajColumnsMayBeNamedInTheFirstLine) {
  const auto read =
      test::value_of(read_traj(holding("# recorded\nt,x,y,z,fx\n0,1,2,3,9\n1,4,5,6,9\n"), TrajColumns{}));
  EXPECT_EQ(read.path.hip_mm[1], Vec3(4, 5, 6));
  EXPECT_EQ(read_traj(holding("t,x,y,z\nt,x,y,z\n0,1,2,3\n"), TrajColumns{}).error().line, 2) << "twice";
  EXPECT_EQ(read_traj(holding("0,1,2,3\nt,x,y,z\n"), TrajColumns{}).error().line, 2) << "not the first";
}

TEST_F(TraceIo, SemicolonsMayStandBesideDecimalCommas) {
  const Vec3 point(1.5, 2.5, 3.5);
  for (const char* text : {"t;x;y;z\n0,001;1,5;2,5;3,5\n", "0,001;1,5;2,5;3,5\n", "0,001 1,5 2,5 3,5\n",
                           "0.001, 1.5, 2.5, 3.5\n", "t;x;y;z\r0,001;1,5;2,5;3,5\r0,002;1,5;2,5;3,5\r"}) {
    const auto read = test::value_of(read_traj(holding(text), TrajColumns{}));
    EXPECT_EQ(read.path.t_s[0], 0.001) << text;
    EXPECT_EQ(read.path.hip_mm[0], point) << text;
  }
  const auto path = test::value_of(read_path_csv(holding("t_s;x_mm;y_mm;z_mm\n0,001;1,5;2,5;3,5\n")));
  EXPECT_EQ(path.hip_mm[0], point);
  EXPECT_EQ(read_traj(holding("0 1 2 3\n1;1;2;3\n"), TrajColumns{}).error().line, 2) << "one form a file";
  const auto old = test::value_of(read_path_csv(holding("t_s,x_mm,y_mm,z_mm\r0,1,2,3\r1,1,2,3\r")));
  EXPECT_EQ(old.size(), 2u);
  for (const Error& error : {read_traj(holding("t,x,y,z\n0,1,1,5,2,5,3,5\n"), TrajColumns{}).error(),
                             read_traj(holding("0,001,1,5,2,5,3,5\n"), TrajColumns{}).error(),
                             read_path_csv(holding("t_s,x_mm,y_mm,z_mm\n0,1,1,5,2,5,3,5\n")).error()}) {
    EXPECT_TRUE(test::contains(error.what, "1 | 5 | 2 | 5 | 3 | 5")) << error.message();
    EXPECT_TRUE(test::contains(error.what, "1.5 | 2.5 | 3.5")) << error.message();
  }
}

TEST_F(TraceIo, TrajMistakes) {
  TrajColumns columns;
  EXPECT_EQ(read_traj(holding("0 1 2 3\n1 2 3\n"), columns).error().line, 2);
  EXPECT_EQ(read_traj(holding("0 1 2 3\n1 2 x 3\n"), columns).error().line, 2);
  EXPECT_EQ(read_traj(holding("0 1 2 3\n0 2 3 4\n"), columns).error().line, 2) << "time stands still";
  EXPECT_FALSE(read_traj(holding("# only words\n"), columns));
  columns.t = -1;
  EXPECT_FALSE(read_traj(holding("0 1 2 3\n"), columns)) << "neither time nor rate";
  columns.t = 1;
  EXPECT_FALSE(read_traj(holding("0 1 2 3\n"), columns)) << "column 1 twice";
  columns.t = 0;
  columns.fx = 3;
  EXPECT_FALSE(read_traj(holding("0 1 2 3\n"), columns)) << "one force of three";
}

}  // namespace
}  // namespace palpate::trace
