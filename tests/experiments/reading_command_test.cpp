// What the commands say of files and places that are unusual: formats that are not read, corners far from the
// origin, numbers for no data, models that move.
#include <gtest/gtest.h>

#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

class Reading : public InFolder {
 protected:
  static void expect_refused(const std::vector<std::string>& arguments,
                             const std::vector<std::string>& parts) {
    const ProcessOutcome run = palpate_command(arguments);
    EXPECT_EQ(run.exit_code, 2) << run.err;
    for (const std::string& part : parts) EXPECT_NE(run.err.find(part), std::string::npos) << run.err;
  }
};

TEST_F(Reading, FormatsThatAreNotReadAreNamed) {
  write_text(folder_ / "scan.laz", "LASF");
  expect_refused({"info", in("scan.laz")}, {"scan.laz", "a LAZ scan", "pdal translate"});
}

TEST_F(Reading, CornersFarFromTheOriginAreTold) {
  write_text(folder_ / "far.txt",
             "id;x(mm);y(mm);z(mm)\n1;5400000000,25;1;0\n2;5400000001,5;2;0\n3;5400000002;4;1\n");
  const ProcessOutcome run = palpate_command({"info", in("far.txt")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.out.find("(5400000000.25, 1, 0) to (5400000002, 4, 1) mm"), std::string::npos) << run.out;
  EXPECT_NE(run.out.find("x, y, z are columns 2, 3, 4"), std::string::npos) << run.out;
}

TEST_F(Reading, ANumberForNoDataIsOfTheCommandLineOrTheScene) {
  write_text(
      folder_ / "a.asc",
      "ncols 4\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 10\n-32768 -32768 -32768 7\n1 2 3 4\n5 6 7 8\n");
  const ProcessOutcome run = palpate_command({"info", in("a.asc"), "--no-data", "-32768"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.out.find("3 dropped"), std::string::npos) << run.out;
  write_text(folder_ / "a.toml", "[[model]]\ncloud = \"a.asc\"\nno_data = -32768\n");
  const ProcessOutcome scene = palpate_command({"info", in("a.toml")});
  ASSERT_EQ(scene.exit_code, 0) << scene.err;
  EXPECT_NE(scene.out.find("3 dropped"), std::string::npos) << scene.out;
  expect_refused({"info", in("a.asc"), "--no-data", "none"}, {"--no-data", "'none'", "-9999"});
  write_text(folder_ / "a.xyz", "1 2 3\n");
  expect_refused({"info", in("a.xyz"), "--no-data", "0"}, {"'no_data' is of grids of heights"});
  expect_refused({"info", "sphere:points=500", "--no-data", "0"}, {"--no-data is of model files"});
}

TEST_F(Reading, AModelThatMovesIsSaidToBe) {
  write_text(folder_ / "moved.toml",
             "[[model]]\ngenerate = \"sphere\"\npoints = 500\nposition_mm = [5, 100, 0]\n[model.motion]\n"
             "velocity_mm_s = [10, 0, 0]\n");
  const ProcessOutcome run = palpate_command({"info", in("moved.toml")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.out.find("moves it by (5, 100, 0) mm"), std::string::npos) << run.out;
  EXPECT_NE(run.out.find("the model moves"), std::string::npos) << run.out;
  // No remedy that is refused in its turn.
  expect_refused({"tune", in("moved.toml"), "--max-error", "5", "--out", in("t")},
                 {"the model 'sphere' moves", "leave out its motion"});
  expect_refused({"stability", in("moved.toml"), "--out", in("s")},
                 {"the model 'sphere' moves", "leave out its motion"});
}

}  // namespace
}  // namespace palpate::experiments
