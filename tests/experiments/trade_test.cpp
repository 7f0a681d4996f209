// Sweeps by hand: which settings dominate which, what a broken row is answered with, which settings there
// are, what tune picks, and what --against calls worse.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include <palpate/generate.h>
#include "experiments/report/fronts.h"
#include "experiments/trade/document.h"
#include "experiments/trade/sweep.h"
#include "tests/experiments/program.h"
#include "toolkit/core/random.h"

namespace palpate::experiments {
namespace {

Measured with(double value, double share) {
  return {value, Interval{value * (1.0 - share), value * (1.0 + share)}};
}

/// A row with these numbers; times and error to `share`.
Row row_with(const std::string& name, double load, double bytes, double prepare_ms, double error,
             double share = 0.01) {
  Row row;
  row.setting = row.renderer = name;
  row.experiment = "e";
  row.machine = {"here", "a cpu", "0123", 2};
  row.works_on = "points";
  row.points = row.scene_points = 1000;
  row.load_percent = with(load, share);
  row.frame_mean_us = with(10.0 * load, share);
  row.frame_p999_us = with(50.0 * load, share);
  row.rate_hz = 1000.0;
  row.bytes = static_cast<std::uint64_t>(bytes);
  row.prepare_ms = with(prepare_ms, share);
  row.preparations = 3;
  row.error_p95_percent = with(error, share);
  row.error_floor_percent = 1e-9;
  return row;
}

TEST(Dominance, NothingIsSaidWithinTheIntervals) {
  std::vector<Row> rows = {row_with("a", 1.00, 100, 10, 1, 0.1), row_with("b", 1.05, 100, 10, 1, 0.1)};
  for (const Standing& s : standings_of(rows)) EXPECT_FALSE(s.dominated);
  rows[1] = row_with("b", 1.5, 100, 10, 1, 0.1);
  EXPECT_TRUE(standings_of(rows)[1].dominated);
}

TEST(Dominance, FewEpisodesDoNotMakeFiveTimesTheErrorAsGood) {
  std::vector<Row> rows = {row_with("exact", 2, 200, 20, 1), row_with("cheap", 1, 100, 10, 5)};
  rows[0].error_p95_percent = with(1.0, 0.95);
  rows[1].error_p95_percent = with(5.0, 0.95);
  for (const Standing& s : standings_of(rows)) EXPECT_FALSE(s.dominated);
  rows[1].error_p95_percent = with(1.04, 0.95);
  EXPECT_TRUE(standings_of(rows)[0].dominated) << "as exact, and cheaper in everything";
}

TEST(Dominance, DriftOfTheAnchorWidensTimesAlone) {
  std::vector<Row> rows = {row_with("a", 1.0, 100, 10, 1), row_with("b", 1.2, 100, 12, 1)};
  EXPECT_TRUE(standings_of(rows)[1].dominated);
  rows[0].anchor_us = 1.0;
  rows[1].anchor_us = 1.5;  // the machine was slower by half when b was measured
  EXPECT_FALSE(standings_of(rows)[1].dominated);
  rows[1].error_p95_percent = with(2.0, 0.01);
  EXPECT_TRUE(standings_of(rows)[1].dominated) << "errors do not drift";
}

TEST(Dominance, MachinesNeverMeet) {
  std::vector<Row> rows = {row_with("a", 1, 100, 10, 1), row_with("b", 2, 200, 20, 2)};
  rows[1].machine.hash = "4567";
  for (const Standing& s : standings_of(rows))
    EXPECT_TRUE(!s.dominated && s.on_fronts.size() == kCosts.size()) << s.on_fronts.size();
}

TEST(Dominance, WhatDidNotRunOrCameFromACacheBeatsNobody) {
  std::vector<Row> rows = {row_with("a", 1, 100, 10, 1), row_with("b", 2, 200, 20, 2)};
  rows[0].from_cache = true;
  EXPECT_FALSE(standings_of(rows)[1].dominated);
  EXPECT_FALSE(cost_of(rows[0], Cost::kPreparation));
  rows[0].from_cache = false;
  rows[0].status = "failed";
  EXPECT_FALSE(standings_of(rows)[1].dominated);
  EXPECT_TRUE(standings_of(rows)[0].on_fronts.empty());
}

TEST(Dominance, ErrorsBelowRoundingAreAlike) {
  std::vector<Row> rows = {row_with("a", 2, 100, 10, 1e-12), row_with("b", 1, 100, 10, 1e-10)};
  EXPECT_TRUE(standings_of(rows)[0].dominated) << "it is no more exact, and slower";
}

/// Where no interval has a width, the definition itself, told again: by values. Wide ones make no circles.
TEST(Dominance, OfRandomRowsIsWhatTheDefinitionSaysAndMakesNoCircles) {
  constexpr std::uint64_t kSeed = 7;
  SCOPED_TRACE(fmt::format("seed {}", kSeed));
  Random random(kSeed);
  for (const double widest : {0.0, 0.4}) {
    const double kinds_of_bytes = widest > 0.0 ? 90.0 : 900.0;
    std::vector<Row> rows;
    for (int i = 0; i < 80; ++i)
      rows.push_back(row_with(fmt::format("r{}", i), 1.0 + random.uniform(),
                              100.0 + std::floor(kinds_of_bytes * random.uniform()), 1.0 + random.uniform(),
                              1.0 + random.uniform(), widest * random.uniform()));
    const std::vector<Standing> standings = standings_of(rows);
    std::size_t dominated = 0;
    for (std::size_t b = 0; b < rows.size(); ++b) {
      const bool beaten = std::any_of(rows.begin(), rows.end(), [&](const Row& a) {
        return &a != &rows[b] && a.load_percent->value <= rows[b].load_percent->value &&
               *a.bytes <= *rows[b].bytes && a.prepare_ms->value <= rows[b].prepare_ms->value &&
               a.error_p95_percent->value <= rows[b].error_p95_percent->value;
      });
      EXPECT_TRUE(widest > 0.0 || standings[b].dominated == beaten) << b;
      if (!standings[b].dominated) continue;
      ++dominated;
      const auto by =
          std::find_if(rows.begin(), rows.end(), [&](const Row& r) { return r.setting == standings[b].by; });
      ASSERT_NE(by, rows.end());
      EXPECT_FALSE(standings[static_cast<std::size_t>(by - rows.begin())].dominated);
    }
    EXPECT_TRUE(widest > 0.0 || dominated > 10u);
    EXPECT_LT(dominated, rows.size());
  }
}

TEST(Rows, AreReadAsTheyWereWritten) {
  Row row = row_with("cloud:a=1", 1.25e-3, 12345, 0.1, 2.0 / 3.0);
  row.options = {{"a", "1"}, {"clean", "thin/cell=2"}};
  row.axes = {"surface", "points"};
  row.anchor_us = 0.1;
  row.trace_hash = "00ff";
  Row failed = row_with("b", 1, 1, 1, 1);
  failed.status = "failed";
  failed.reason = "because \"so\"\n";
  failed.prepare_ms.reset();
  failed.error_p95_percent.reset();
  const std::string text = rows_text({row, failed});
  const auto back = value_of(rows_of(text, "rows.jsonl"));
  EXPECT_EQ(rows_text(back), text);
  EXPECT_EQ(back[0].error_p95_percent->interval->low, row.error_p95_percent->interval->low);
}

TEST(Rows, ABrokenOneIsRefusedWithItsLine) {
  const std::string good = rows_text({row_with("a", 1, 1, 1, 1)});
  Row other = row_with("b", 1, 1, 1, 1);
  other.experiment = "f";
  const auto replaced = [&](const std::string& from, const std::string& to) {
    std::string text = rows_text({row_with("b", 1, 1, 1, 1)});
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return text.replace(at, from.size(), to);
  };
  for (const std::string& bad :
       {std::string("nonsense\n"), std::string("{}\n"), std::string("[1]\n"), std::string("\n"), good,
        rows_text({other}), good.substr(0, good.size() / 2), replaced("palpate-row/1", "palpate-row/9"),
        replaced("\"ok\"", "\"fine\""), replaced("\"points\":1000", "\"points\":-1"),
        replaced("\"points\":1000", "\"points\":1e400"), replaced("\"bytes\":1", "\"bytes\":null"),
        replaced("\"setting\":\"b\"", "\"setting\":\"\""),
        replaced("\"rate_divisor\":1", "\"rate_divisor\":0"), std::string(5000, '[') + "\n"}) {
    const auto rows = rows_of(good + bad, "rows.jsonl");
    ASSERT_FALSE(rows) << bad;
    EXPECT_THAT(rows.error().message(), HasSubstr("rows.jsonl:2: "));
    EXPECT_FALSE(rows.error().remedy.empty());
  }
}

// ---- settings

class Settings : public testing::Test {
 protected:
  Settings() {
    cloud::GeneratedModel made = cloud::generate(*parse_named_options("plane:points=441")).value();
    render::ModelInput model;
    model.cloud = std::make_shared<const cloud::Cloud>(std::move(made.cloud));
    scene_.models.push_back(model);
  }
  std::vector<Setting> of(const std::string& renderers, const std::string& axes, bool full = false) const {
    SettingsRequest request;
    if (!renderers.empty()) request.renderers = parse_renderers(renderers, registry_).value();
    request.axes = parse_axes(axes).value();
    request.full = full;
    request.resolution_mm = 1.0;
    return settings_of(request, scene_, registry_);
  }
  render::Registry registry_ = all_renderers();
  render::SceneInput scene_;
};

TEST_F(Settings, TurnTheBoundsOfWalks) {
  std::set<std::string> texts;
  for (const Setting& setting : of("cloud,cloud-smooth,stream-proxy", "bounds")) texts.insert(setting.text);
  for (const char* text : {"cloud:walk_steps=128", "cloud:walk_steps=512", "cloud-smooth:walk_steps=12",
                           "stream-proxy:walk_steps=64"})
    EXPECT_TRUE(texts.contains(text)) << text;
}

TEST_F(Settings, BeginWithWhatIsUsualAndTurnOneThingAfterTheOther) {
  const std::vector<Setting> all = of("cloud,cloud-smooth", "points,detail,rate");
  ASSERT_GT(all.size(), 10u);
  EXPECT_EQ(all[0].text, "cloud");
  EXPECT_EQ(all[1].text, "cloud-smooth");
  std::size_t before = 0;
  std::set<std::string> texts;
  for (const Setting& setting : all) {
    EXPECT_GE(setting.axes.size(), before) << setting.text;
    before = setting.axes.size();
    EXPECT_TRUE(texts.insert(setting.text).second) << setting.text;
    for (const std::string& axis : setting.axes)
      EXPECT_TRUE(axis == "points" || axis == "detail" || axis == "rate");
  }
  EXPECT_EQ(before, 2u);
  EXPECT_TRUE(texts.contains("cloud-smooth:detail=4:rate_divisor=2"));
  EXPECT_TRUE(texts.contains("cloud:clean=thin/cell=1.5"));
  EXPECT_GT(of("cloud,cloud-smooth", "points,detail,rate", true).size(), all.size());
}

TEST_F(Settings, AreOfTheirRenderersAlone) {
  for (const Setting& setting : of("", "")) {
    const render::RendererInfo* info = registry_.find(setting.request.name);
    ASSERT_NE(info, nullptr);
    EXPECT_TRUE(validate(setting.request.options, info->options, info->name)) << setting.text;
    EXPECT_NE(info->role, render::Role::kReference);
    EXPECT_NE(info->role, render::Role::kOracle);
  }
}

TEST(Axes, UnknownAndDoubleOnesAreRefused) {
  EXPECT_EQ(parse_axes("")->size(), axes().size());
  EXPECT_THAT(parse_axes("shadng").error().message(), HasSubstr("shading"));
  EXPECT_FALSE(parse_axes("shading,shading"));
  EXPECT_FALSE(parse_axes(","));
}

// ---- rates and precision

TEST(Held, ForceStandsUntilTheNextFrame) {
  trace::ProbePath path;
  trace::ForceTrace trace;
  for (int i = 0; i < 7; ++i) {
    path.t_s.push_back(1e-3 * i);
    path.hip_mm.emplace_back(0.0, 0.0, i);
  }
  for (int i = 0; i < 3; ++i) {
    render::Frame frame;
    frame.contact = i == 1;
    frame.force_n = Vec3(0.0, 0.0, i == 1 ? 0.5 : 0.0);
    frame.god_object_mm = i == 1 ? Vec3(1.0, 2.0, 3.0) : path.hip_mm[static_cast<std::size_t>(3 * i)];
    trace.frames.push_back(frame);
  }
  const trace::ForceTrace whole = held(trace, path, 3);
  ASSERT_EQ(whole.frames.size(), path.size());
  for (std::size_t i = 0; i < path.size(); ++i) {
    const bool touching = i >= 3 && i < 6;
    EXPECT_EQ(whole.frames[i].contact, touching) << i;
    EXPECT_EQ(whole.frames[i].force_n.z(), touching ? 0.5 : 0.0);
    EXPECT_EQ(whole.frames[i].god_object_mm, touching ? Vec3(1.0, 2.0, 3.0) : path.hip_mm[i]);
  }
}

TEST(StageSeen, RoundsCoordinatesToTheBitsThatAreAskedFor) {
  for (const double scale : {1e-3, 1.0, 1e6}) {
    Stage stage;
    cloud::GeneratedModel made =
        cloud::generate(*parse_named_options("sphere:points=2000:sampling=random")).value();
    for (auto* values : {&made.cloud.x_mm, &made.cloud.y_mm, &made.cloud.z_mm})
      for (float& v : *values) v *= static_cast<float>(scale);
    made.cloud.origin_mm = Vec3(1e3 * scale, 0.0, 0.0);
    stage.scene.input.models.emplace_back();
    stage.scene.input.models[0].cloud = std::make_shared<const cloud::Cloud>(std::move(made.cloud));
    const cloud::Cloud& before = *stage.scene.input.models[0].cloud;
    const Stage seen = stage_seen(stage, 10, 1);
    const cloud::Cloud& after = *seen.scene.input.models[0].cloud;
    const double step = before.box_mm().extent_mm().maxCoeff() / 1024.0;
    double worst = 0.0;
    std::set<float> places;
    for (std::size_t i = 0; i < before.size(); ++i) {
      worst =
          std::max(worst, std::abs(static_cast<double>(after.x_mm[i]) - static_cast<double>(before.x_mm[i])));
      places.insert(after.x_mm[i]);
    }
    EXPECT_LE(worst, 0.5 * step * (1.0 + 1e-3));
    EXPECT_GT(worst, 0.4 * step);
    EXPECT_LE(places.size(), 1025u);
  }
}

// ---- tune

TEST(Tune, TakesTheCheapestThatIsAccurateEnoughAndTheMostAccurateThatIsCheapEnough) {
  const std::vector<Row> rows = {row_with("coarse", 1, 100, 10, 9), row_with("middle", 2, 200, 10, 4),
                                 row_with("fine", 5, 900, 10, 1)};
  const auto best = [&](const TuneLimits& limits) { return rows[candidates(rows, limits).front()].setting; };
  EXPECT_EQ(best({5.0, {}, {}}), "middle");
  EXPECT_EQ(best({4.0, {}, {}}), "fine") << "the middle one's interval goes up to 4.04";
  EXPECT_EQ(best({{}, 110.0, {}}), "middle");
  EXPECT_EQ(best({{}, 110.0, 150.0}), "coarse");
  const TuneLimits limits{5.0, 110.0, 150.0};  // %, us, bytes
  EXPECT_TRUE(candidates(rows, limits).empty());
  EXPECT_EQ(rows[*nearest_miss(rows, limits)].setting, "middle")
      << "200 of 150 bytes; the others 9 of 5 %, 900 bytes";
}

TEST(Tune, FewEpisodesDoNotMakeFiveTimesTheErrorTheMostAccurate) {
  std::vector<Row> rows = {row_with("exact", 2, 200, 20, 1), row_with("cheap", 1, 100, 10, 5),
                           row_with("as exact", 1.5, 100, 10, 1.04)};
  for (Row& row : rows) row.error_p95_percent = with(row.error_p95_percent->value, 0.95);
  const std::vector<std::size_t> best = candidates(rows, {{}, {}, 1e6});
  ASSERT_EQ(best.size(), 3u);
  EXPECT_EQ(rows[best[0]].setting, "as exact") << "within a twentieth the cheaper one";
  EXPECT_EQ(rows[best[2]].setting, "cheap");
}

TEST(Tune, WhatCannotBeToldApartIsChosenByMemory) {
  const std::vector<Row> rows = {row_with("a", 1.00, 900, 10, 1, 0.1), row_with("b", 1.05, 100, 10, 1, 0.1),
                                 row_with("c", 3.0, 10, 10, 1, 0.1)};
  const std::vector<std::size_t> best = candidates(rows, {5.0, {}, {}});
  ASSERT_EQ(best.size(), 3u);
  EXPECT_EQ(rows[best[0]].setting, "b");
  EXPECT_EQ(rows[best[1]].setting, "a");
}

// ---- against

metrics::ResultDocument document_with(double mean_us, std::size_t bytes, double rms) {
  metrics::ResultDocument document;
  document.path_hash = "p";
  document.machine.cpu = "a cpu";
  metrics::RendererResult result;
  result.label = result.name = "cloud";
  result.frame_all.emplace();
  result.frame_all->mean_us = mean_us;
  result.frame_all->mean_interval_us = Interval{0.95 * mean_us, 1.05 * mean_us};
  result.prepare.emplace();
  result.prepare->total_ms = 10.0;
  result.prepare->bytes = bytes;
  result.accuracy.emplace();
  result.accuracy->force_rms_percent = rms;
  document.renderers.push_back(result);
  return document;
}

ChangeVerdict verdict_of(const Changes& changes, const std::string& number) {
  for (const Change& c : changes.all)
    if (c.number == number) return c.verdict;
  ADD_FAILURE() << number;
  return ChangeVerdict::kSame;
}

TEST(Against, SaysWhatIsBetterAndWorseBeyondTheInterval) {
  const auto changes = value_of(changes_between(document_with(1.0, 100, 2.0), document_with(1.5, 90, 2.0)));
  EXPECT_EQ(verdict_of(changes, "frame_all.mean_us"), ChangeVerdict::kWorse);
  EXPECT_EQ(verdict_of(changes, "memory.bytes"), ChangeVerdict::kBetter);
  EXPECT_EQ(verdict_of(changes, "accuracy.force_rms_percent"), ChangeVerdict::kSame);
  EXPECT_FALSE(changes.worse_for_sure()) << "a time alone is the machine's";
  const auto within = changes_between(document_with(1.0, 100, 2.0), document_with(1.05, 101, 2.0));
  EXPECT_EQ(verdict_of(*within, "frame_all.mean_us"), ChangeVerdict::kSame);
  EXPECT_TRUE(within->worse_for_sure()) << "a byte is a byte";
}

TEST(Against, TimesOfOtherMachinesAndOtherPathsAreNotCompared) {
  metrics::ResultDocument other = document_with(1.0, 100, 2.0);
  other.machine.cpu = "another cpu";
  const auto changes = value_of(changes_between(other, document_with(9.0, 100, 2.0)));
  for (const Change& c : changes.all) EXPECT_FALSE(c.is_time) << c.number;
  EXPECT_FALSE(changes.notes.empty());
  other.path_hash = "q";
  EXPECT_FALSE(changes_between(other, document_with(1.0, 100, 2.0)));
}

// ---- the picture

TEST(Fronts, AreNumberedByErrorAndJoinTheCheapest) {
  std::vector<FrontPoint> points = {{"c", "x", 1, 1, 1, 9, 8, 10, true},
                                    {"a", "x", 5, 5, 5, 0, 0, 0, true},
                                    {"b", "y", 6, 6, 6, 3, 2, 4, true},
                                    {"d", "y", 9, 9, 9, 9, 9, 9, false}};
  const std::vector<FrontPoint> front = numbered(points);
  ASSERT_EQ(front.size(), 3u);
  EXPECT_EQ(front[0].setting, "a");
  EXPECT_EQ(front[2].setting, "c");
  const Chart chart = front_chart("f", "t", "cost", points);
  EXPECT_EQ(chart.series[0].x, (std::vector<double>{kLeastErrorPercent, 9.0})) << "b costs more than a";
  EXPECT_EQ(chart.series.size(), 3u);
  EXPECT_EQ(chart.series[1].bars.size(), chart.series[1].x.size());
}

TEST(Fronts, OfAKindAreItsOwnAndNamesCoverNoPoint) {
  // Of the points b beats c; the mesh is beaten by b too, but by no other mesh.
  const std::vector<KindPoint> points = {{Kind::kPoints, {"a", "smooth", 5, 5, 5, 1, 1, 1, false}},
                                         {Kind::kPoints, {"b", "cloud", 2, 1, 3, 4, 3, 5, false}},
                                         {Kind::kPoints, {"c", "cloud", 3, 3, 3, 6, 6, 6, false}},
                                         {Kind::kMesh, {"d", "mesh", 4, 4, 4, 8, 7, 9, false}},
                                         {Kind::kMesh, {"e", "crowded", 4, 4, 4, 8, 7, 9, false}}};
  const Chart chart = kinds_chart("k", "t", "cost", points);
  const auto called = [&](const std::string& label) -> const Series* {
    for (const Series& series : chart.series)
      if (!series.bars.empty() && series.label.starts_with(label)) return &series;
    return nullptr;
  };
  ASSERT_NE(called("points: best of 3"), nullptr);
  EXPECT_EQ(called("points: best of 3")->x, (std::vector<double>{1, 4}));
  EXPECT_EQ(called("points: best of 3")->bars[1].y_high, 3.0);
  ASSERT_NE(called("other points"), nullptr);
  EXPECT_EQ(called("other points")->x, std::vector<double>{6});
  ASSERT_NE(called("meshes: best of 2"), nullptr);
  EXPECT_EQ(called("distance grids"), nullptr);
  EXPECT_EQ(count_of(chart.extra, "'cloud'"), 1u);
  // Two renderers in one place: the second name takes another side of it.
  const auto side_of = [&](const std::string& name) {
    const std::size_t at = chart.extra.find("'" + name + "'"), offset = chart.extra.find("8,4 ", at);
    return chart.extra.substr(offset, chart.extra.find(" font", at) - offset);
  };
  ASSERT_EQ(count_of(chart.extra, "'mesh'"), 1u);
  ASSERT_EQ(count_of(chart.extra, "'crowded'"), 1u);
  EXPECT_NE(side_of("mesh"), side_of("crowded"));
}

}  // namespace
}  // namespace palpate::experiments
