// The short set of the stress matrix: no cell of ours turns red unseen; and what the matrix says is true.

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "experiments/session/session.h"
#include "experiments/stress/cell.h"
#include "experiments/stress/stress.h"
#include "tests/experiments/program.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::experiments {
namespace {

const render::Registry& registry() {
  static const render::Registry all = all_renderers();
  return all;
}

StressCase case_of(const std::string& name) {
  for (StressCase& one : stress_cases())
    if (one.name == name) return one;
  ADD_FAILURE() << "no case " << name;
  return {};
}

RendererRequest request_of(const std::string& name) {
  return {name, name, {}, {}};
}

TEST(Stress, EveryCaseCanBeMadeAndSaysWhatItIs) {
  std::set<std::string> names;
  for (const StressCase& one : stress_cases()) {
    EXPECT_TRUE(names.insert(one.name).second) << one.name;
    EXPECT_GT(one.text.size(), 10u) << one.name;
    if (!one.quick) continue;
    const Result<StressSetup> made = one.make();
    ASSERT_TRUE(made) << one.name << ": " << made.error().message();
    EXPECT_EQ(made->path.size(), made->due.size()) << one.name;
    EXPECT_TRUE(std::is_sorted(made->path.t_s.begin(), made->path.t_s.end())) << one.name;
    EXPECT_GT(made->scene.force_limit_n, 0.0) << one.name;
  }
  EXPECT_GE(names.size(), 90u);
}

// A long frame is a limit where the renderer says beforehand that its bound is longer than a tick, and
// nowhere else; none of ours says so.
TEST(Stress, ABoundLongerThanATickIsALimitThatIsStated) {
  for (const render::RendererInfo& info : registry().all()) {
    const auto made = registry().make(info.name, {});
    ASSERT_TRUE(made) << info.name;
    if (info.role == render::Role::kOurs) {
      EXPECT_FALSE(render::may_miss_a_tick((*made)->describe().work_bound)) << info.name;
    }
  }
  const StressCell cell = run_cell(case_of("fan-1000"), request_of("mesh-proxy"), registry());
  EXPECT_EQ(cell.status, CellStatus::kLimit) << cell.check << ": " << cell.cause;
  EXPECT_EQ(cell.check, "bounded");
  EXPECT_THAT(cell.cause, HasSubstr("longer than a tick at worst"));
  EXPECT_GT(cell.contact_frames, 0u);
}

class OursAtTheExtremes : public ::testing::TestWithParam<const char*> {};

TEST_P(OursAtTheExtremes, HoldWhatMustHold) {
  const RendererRequest request = request_of(GetParam());
  std::size_t ok = 0;
  for (const StressCase& one : stress_cases()) {
    if (!one.quick) continue;
    const StressCell cell = run_cell(one, request, registry());
    ok += cell.status == CellStatus::kOk;
    EXPECT_NE(cell.status, CellStatus::kFailed) << one.name << ", " << cell.check << ": " << cell.cause;
  }
  EXPECT_GT(ok, 10u) << "most cases are refused";
}
INSTANTIATE_TEST_SUITE_P(Stress, OursAtTheExtremes, ::testing::Values("cloud", "cloud-smooth", "heightfield"),
                         [](const auto& tested) {
                           std::string name = tested.param;
                           std::erase(name, '-');
                           return name;
                         });

// A cell can be red: one renderer that is known to feel boxes from outside, and a rule that is broken on
// purpose.
TEST(Stress, WhatIsWrongIsSeen) {
  StressCase lying = case_of("scale-unit");
  const auto make = lying.make;
  lying.make = [make]() -> Result<StressSetup> {
    Result<StressSetup> setup = make();
    std::fill(setup->due.begin(), setup->due.end(), Due::kFree);
    return setup;
  };
  const StressCell felt = run_cell(lying, request_of("cloud"), registry());
  EXPECT_EQ(felt.status, CellStatus::kFailed);
  EXPECT_EQ(felt.check, "free");
  lying.make = [make]() -> Result<StressSetup> {
    Result<StressSetup> setup = make();
    auto other = std::make_shared<StressSetup>(*setup->twin);
    other->scene.models.front().surface.stiffness_n_per_mm *= 1.0 + 1e-15;
    setup->twin = other;
    return setup;
  };
  const StressCell twin = run_cell(lying, request_of("cloud"), registry());
  EXPECT_EQ(twin.status, CellStatus::kFailed);
  EXPECT_EQ(twin.check, "twin");
}

// What is felt wrongly is a limit where the renderer warned of these very points, and only then; what is felt
// rightly stays so.
TEST(Stress, AStatedLimitIsTheRenderersOwnWarning) {
  struct Told {
    const char *renderer, *name, *words;
  };
  for (const Told& told : {Told{"cloud-smooth", "plate-0.1mm", "in two layers"},
                           {"cloud-smooth", "plate-0.01mm", "in two layers"},
                           {"cloud-smooth", "vase", "sides=both"},
                           {"cloud", "vase", "sides=both"},
                           {"cloud-smooth", "volume", "fill a volume"}}) {
    const StressCell cell = run_cell(case_of(told.name), request_of(told.renderer), registry());
    EXPECT_NE(cell.status, CellStatus::kFailed) << told.name << ", " << cell.check << ": " << cell.cause;
    ASSERT_FALSE(cell.warnings.empty()) << told.renderer << ", " << told.name;
    EXPECT_THAT(cell.warnings.front(), HasSubstr(told.words));
    if (cell.status == CellStatus::kLimit) {
      EXPECT_THAT(cell.cause, HasSubstr(cell.warnings.front()));
    }
  }
  // The remedy that is named.
  for (const char* renderer : {"cloud", "cloud-smooth"}) {
    const StressCell cell = run_cell(case_of("vase-both-sides"), request_of(renderer), registry());
    EXPECT_EQ(cell.status, CellStatus::kOk) << renderer << ", " << cell.check << ": " << cell.cause;
    EXPECT_TRUE(cell.warnings.empty()) << renderer;
  }
  EXPECT_EQ(run_cell(case_of("plate-0.01mm"), request_of("cloud"), registry()).status, CellStatus::kOk);
}

// Embree computes in single precision: what its mesh's own frame is for. And a lattice of voxels answers the
// same wherever its points lie.
TEST(Stress, AMeshFarFromItsOriginIsFeltInItsOwnFrame) {
  RendererRequest world = request_of("mesh-godobject");
  world.options.set("frame", "world");
  EXPECT_EQ(run_cell(case_of("scale-unit"), world, registry()).status, CellStatus::kOk);
  // Embree's answers are taken up in double: as long as it finds the facets at all, nothing is lost.
  EXPECT_EQ(run_cell(case_of("offset-1e6"), world, registry()).status, CellStatus::kOk);
  for (const char* name : {"offset-1e9", "offset-closed-1e9"}) {
    const StressCell local = run_cell(case_of(name), request_of("mesh-godobject"), registry());
    EXPECT_EQ(local.status, CellStatus::kOk) << name << ", " << local.check << ": " << local.cause;
    const StressCell lost = run_cell(case_of(name), world, registry());
    EXPECT_EQ(lost.status, CellStatus::kFailed) << name;
    EXPECT_EQ(lost.check, "felt") << name;
  }
  const StressCell voxels = run_cell(case_of("offset-closed-1e9"), request_of("sdf-godobject"), registry());
  EXPECT_EQ(voxels.status, CellStatus::kOk) << voxels.check << ": " << voxels.cause;
}

TEST(Stress, OursAnswerTheSameAtEveryPlace) {
  for (const char* renderer : {"cloud", "cloud-smooth", "heightfield"})
    for (const StressCase& one : stress_cases()) {
      if (one.group != "offset") continue;
      const StressCell cell = run_cell(one, request_of(renderer), registry());
      EXPECT_NE(cell.status, CellStatus::kFailed) << renderer << ", " << one.name << ": " << cell.cause;
      if (cell.status != CellStatus::kOk || cell.twin_bound_n == 0.0) continue;
      EXPECT_GT(cell.contact_frames, 50u) << renderer << ", " << one.name;
      EXPECT_LE(cell.twin_difference_n, cell.twin_bound_n) << renderer << ", " << one.name;
      EXPECT_LT(cell.twin_bound_n, 1e-3) << "a bound that means something, N";
    }
}

// One point in ten in the air, or one in two: the sheet stays open, and is felt from below. In the fog
// `cloud-smooth` holds on below the sheet, as the matrix shows.
TEST(Stress, FlyingPixelsCloseNoSheet) {
  for (const char* renderer : {"cloud", "cloud-smooth"})
    for (const char* name : {"flying-sheet", "flying-fog"}) {
      if (std::string(renderer) == "cloud-smooth" && std::string(name) == "flying-fog") continue;
      const StressCell cell = run_cell(case_of(name), request_of(renderer), registry());
      EXPECT_NE(cell.status, CellStatus::kFailed) << renderer << ", " << cell.check << ": " << cell.cause;
    }
}

TEST(Stress, AMeshIsFeltWhereManyFacetsMeet) {
  for (const char* name : {"fan-400", "fan-1000"}) {
    const StressCell cell = run_cell(case_of(name), request_of("mesh-godobject"), registry());
    EXPECT_EQ(cell.status, CellStatus::kOk) << name << ", " << cell.check << ": " << cell.cause;
    EXPECT_TRUE(cell.warnings.empty()) << cell.warnings.front();
    EXPECT_GT(cell.contact_frames, 500u) << name;
    EXPECT_EQ(run_cell(case_of(name), request_of("cloud"), registry()).status, CellStatus::kSkipped);
  }
}

TEST(Stress, AFieldEndsBelowItsBand) {
  for (const char* name : {"deep-slide", "depth-10x"}) {
    const StressCase deep = case_of(name);
    const RendererRequest field = request_of("vector-field");
    const StressCell cell = run_cell(deep, field, registry());
    EXPECT_EQ(cell.status, CellStatus::kFailed) << name;
    EXPECT_EQ(cell.check, "felt") << name;
    EXPECT_THAT(known_reason(field, deep, cell), HasSubstr("Deeper than its band")) << name;
    EXPECT_EQ(run_cell(deep, request_of("cloud"), registry()).status, CellStatus::kOk) << name;
  }
}

TEST(Stress, ACrashAndAHangAreRedCellsAndTheRowGoesOn) {
  const StressCase good = case_of("one-point");
  StressCase crash = good, hang = good;
  crash.name = "crash";
  crash.make = []() -> Result<StressSetup> {
    ::raise(SIGSEGV);
    return Error{};
  };
  hang.name = "hang";
  hang.make = []() -> Result<StressSetup> {
    for (volatile int endless = 0;;) endless = endless + 1;
  };
  std::vector<StressCell> row;
  CellLimits limits{.seconds = 2.0};
  run_row_apart({good, crash, hang, good}, request_of("cloud"), registry(), limits, [&](StressCell&& cell) {
    row.push_back(std::move(cell));
    return true;
  });
  ASSERT_EQ(row.size(), 4u);
  EXPECT_NE(row[0].status, CellStatus::kFailed) << row[0].cause;
  EXPECT_THAT(row[1].cause, HasSubstr("signal 11"));
  EXPECT_THAT(row[2].cause, HasSubstr("not done"));
  EXPECT_EQ(row[3].trace_hash, row[0].trace_hash);
}

class StressCommand : public OnCommandLine {};

TEST_F(StressCommand, WritesTheMatrixTwiceTheSame) {
  const char* const line = "test stress --renderers cloud,penalty-grid --cases one-point,hip-nan --out @/out";
  succeeds(line);
  const std::string text = text_in("out/stress.json");
  expect_valid("stress", text);
  const nlohmann::json first = nlohmann::json::parse(text);
  EXPECT_EQ(first["cells"].size(), 4u);
  for (const nlohmann::json& row : first["renderers"])
    for (const char* status : {"ok", "limit", "failed", "skipped"}) {
      const auto is = [&](const nlohmann::json& cell) {
        return cell["renderer"] == row["label"] && cell["status"] == status;
      };
      EXPECT_EQ(row[status], std::count_if(first["cells"].begin(), first["cells"].end(), is)) << row;
    }
  const std::string page = text_in("out/report.html");
  EXPECT_THAT(page, HasSubstr("<svg"));
  draw_without_page("out");
  EXPECT_EQ(text_in("out/report.html"), page);
  succeeds(line);
  EXPECT_EQ(json_in("out/stress.json")["cells"], first["cells"]);
}

TEST_F(StressCommand, HashesOfAnotherRunMustBeTheSame) {
  const auto run = [&](const std::string& out, const Words& against) {
    return words("test stress --renderers cloud,mls-proxy --cases one-point,scale-unit --verbose --out",
                 in(out), against);
  };
  succeeds(run("first", {}));
  const ProcessOutcome same = succeeds(run("second", words("--against @/first/stress.json")));
  EXPECT_THAT(same.out, HasSubstr("Trace hashes against"));
  expect_valid("stress", text_in("second/stress.json"));
  nlohmann::json other = json_in("first/stress.json");
  for (nlohmann::json& cell : other["cells"])
    if (cell["renderer"] == "cloud" && cell["case"] == "scale-unit") cell["trace_hash"] = "0123456789abcdef";
  write_text(in("other.json"), other.dump());
  EXPECT_EQ(palpate(run("third", words("--against @/other.json"))).exit_code, 1);
  const nlohmann::json third = json_in("third/stress.json")["against"]["renderers"];
  EXPECT_EQ(third[0]["different"], nlohmann::json::array({"scale-unit"}));
  EXPECT_EQ(third[1]["same"], 2);
  write_text(in("none.json"), "{}");
  refuses("is no stress.json", run("fourth", words("--against @/none.json")));
  EXPECT_FALSE(exists("fourth"));
}

// docs/results/measured.md: `palpate report DIR --docs .` takes both at once.
TEST(Stress, PictureAndTableOfThePageAreOfOneRun) {
  const std::string figures = std::string(PALPATE_DOCS) + "/figures/";
  const nlohmann::json taken = nlohmann::json::parse(file_text(figures + "stress.json"));
  const std::string picture = file_text(figures + "stress.svg");
  std::map<std::string, std::size_t> cells;
  for (const nlohmann::json& row : taken["documents"]["stress.json"]["renderers"])
    for (const char* status : {"ok", "limit", "failed", "skipped"})
      cells[status] += row[status].get<std::size_t>();
  EXPECT_GT(cells["ok"], 200u);
  for (const auto& [status, colour] : std::map<std::string, std::string>{
           {"ok", "#009e73"}, {"limit", "#f0e442"}, {"failed", "#d55e00"}, {"skipped", "#e6e6e6"}})
    EXPECT_EQ(count_of(picture, "fill=\"" + colour + "\""), cells[status] + 1)
        << status << ", and the legend";
}

TEST_F(StressCommand, RefusesWhatItDoesNotKnow) {
  refuses({"there is no case 'no-such-case'", "scale-1e-6", "groups from scale (scale-unit "},
          "test stress --cases no-such-case --out @/out");
  EXPECT_FALSE(exists("out"));
}

}  // namespace
}  // namespace palpate::experiments
