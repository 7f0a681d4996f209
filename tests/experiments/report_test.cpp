// Tables, headlines and the page are pure functions of results.
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "experiments/command/reproduction.h"
#include "experiments/report/figures.h"
#include "experiments/report/page.h"
#include "experiments/tables/manifest.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

metrics::RendererResult result(const std::string& label, double mean_us, double prepare_ms,
                               std::uint64_t false_frames) {
  metrics::RendererResult r;
  r.label = r.name = label;
  r.model = metrics::RendererResult::Model{1000, 0.1};
  r.prepare = render::PrepareReport{};
  r.prepare->total_ms = prepare_ms;
  r.prepare->bytes = 48000;
  r.frame = trace::FrameStatistics{};
  r.frame->frames = 100;
  r.frame->contact_frames = 70;
  r.frame->mean_us = mean_us;
  r.frame->min_us = mean_us / 2;
  r.frame->max_us = mean_us * 3;
  r.accuracy = metrics::Accuracy{};
  r.accuracy->force_rms_n = 0.01;
  r.accuracy->false_contact_frames = false_frames;
  r.accuracy->longest_stick_frames = false_frames;
  return r;
}

metrics::ResultDocument document() {
  metrics::ResultDocument d;
  d.scene = "plane";
  d.path = "tap <&>";
  d.renderers = {result("cloud", 0.2, 100.0, 0), result("cloud-literal", 1.5, 120.0, 1234)};
  return d;
}

TEST(Numbers, AreShortAndReadable) {
  EXPECT_EQ(count_text(0), "0");
  EXPECT_EQ(count_text(999), "999");
  EXPECT_EQ(count_text(1002001), "1,002,001");
  EXPECT_EQ(short_number(0.0), "0");
  EXPECT_EQ(short_number(37.4), "37.4");
  EXPECT_EQ(short_number(267.4), "267");
  EXPECT_EQ(short_number(0.0374), "0.0374");
  EXPECT_EQ(short_number(2.4), "2.40");
  EXPECT_EQ(short_number(12345.6), "12,346");
  EXPECT_EQ(short_number(-5.0), "-5.00");
  EXPECT_EQ(short_number(std::nullopt), "–");
  EXPECT_EQ(duration_text(0.5), "0.500 ms");
  EXPECT_EQ(duration_text(2500.0), "2.50 s");
  EXPECT_EQ(duration_text(90000.0), "1.50 min");
}

TEST(ComparisonTable, MarksTheBestOfARow) {
  const Table table = comparison_table(document());
  ASSERT_EQ(table.columns.size(), 3u);
  bool found = false;
  for (const auto& row : table.rows) {
    if (row.size() > 1) {
      EXPECT_EQ(row.size(), 3u);
    }
    if (row[0].text != "mean, µs") continue;
    found = true;
    EXPECT_TRUE(row[1].best);
    EXPECT_FALSE(row[2].best);
    EXPECT_EQ(row[1].text, "0.200");
    EXPECT_EQ(row[2].text, "1.500") << "as many decimals as its neighbour";
  }
  EXPECT_TRUE(found);
}

TEST(ComparisonTable, ARunThatDidNotFinishSaysSo) {
  metrics::ResultDocument d = document();
  d.renderers[1].status = metrics::RunStatus::kDidNotFinish;
  d.renderers[1].reason = "preparation stopped after 3 s";
  d.renderers[1].frame.reset();
  d.renderers[1].accuracy.reset();
  const std::string text = to_text(comparison_table(d));
  EXPECT_NE(text.find("did not finish"), std::string::npos);
  EXPECT_NE(text.find("preparation stopped after 3 s"), std::string::npos);
  bool said = false;
  for (const Headline& line : headlines_of(d))
    said = said || line.text.find("did not finish") != std::string::npos;
  EXPECT_TRUE(said);
}

TEST(AlignedNumbers, ShareTheirDecimals) {
  using Texts = std::vector<std::string>;
  EXPECT_EQ(aligned_numbers({0.0794, 0.00173, 0.00157}), (Texts{"0.07940", "0.00173", "0.00157"}));
  EXPECT_EQ(aligned_numbers({23.9, 0.06, 0.0, std::nullopt}), (Texts{"23.900", "0.060", "0", "–"}));
  EXPECT_EQ(aligned_numbers({12556.4, 72.9}), (Texts{"12,556", "73"}));
  EXPECT_EQ(aligned_numbers({4.84, 6.1e-6}), (Texts{"4.8400", "<0.0001"}));
  EXPECT_EQ(aligned_numbers({1234567.0}), (Texts{"1,234,567"}));
  EXPECT_EQ(aligned_numbers({}), Texts{});
  EXPECT_EQ(aligned_numbers({-5.0, 0.25}), (Texts{"-5.000", "0.250"}));
  const AlignedTimes times = aligned_times({149.4, 43100.0});
  EXPECT_EQ(times.unit, "s");
  EXPECT_EQ(times.texts, (Texts{"0.149", "43.100"}));
  EXPECT_EQ(aligned_times({149.4, 456.0}).unit, "ms");
}

TEST(Headlines, SayWhoKeepsContactAndRankTheOthers) {
  std::string all;
  for (const Headline& line : headlines_of(document())) all += line.lead + ": " + line.text + "\n";
  EXPECT_NE(all.find("Contact: right with cloud: nothing missed, false or stuck"), std::string::npos) << all;
  EXPECT_NE(all.find("wrong with cloud-literal: 1,234 frames of false contact"), std::string::npos) << all;
  EXPECT_NE(all.find("Mean frame in contact: cloud 0.200 µs, cloud-literal 1.50 µs (7.50 times)"),
            std::string::npos)
      << all;
}

TEST(Headlines, SayTheSameFaultOnce) {
  metrics::ResultDocument d = document();
  d.renderers.push_back(result("twin", 1.0, 90.0, 1234));
  std::string all;
  for (const Headline& line : headlines_of(d)) all += line.text;
  EXPECT_NE(all.find("wrong with cloud-literal and twin: 1,234"), std::string::npos) << all;
}

TEST(Page, EscapesWhatItIsGiven) {
  Page page = begin_page("A <title>", document());
  page.headlines = {{"<b>", {{"<script>", "<script>alert(1)</script>"}}}};
  page.sections.push_back({"s", "Section", {document().path}, {comparison_table(document())}, {}, {}});
  const std::string html = to_html(page);
  EXPECT_EQ(html.find("<script"), std::string::npos);
  EXPECT_NE(html.find("tap &lt;&amp;&gt;"), std::string::npos);
  EXPECT_EQ(html.find("<b>"), std::string::npos);
  EXPECT_NE(html.find("A &lt;title&gt;"), std::string::npos);
}

class Charts : public InFolder {};

TEST_F(Charts, EverySeriesIsDrawnUnderItsOwnName) {
  // Longer and longer interruptions, and a series of nothing else.
  constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
  Chart chart;
  chart.name = "gaps";
  chart.style = Chart::Style::kSteps;
  chart.log_y = true;
  chart.series = {
      {"first", "#0072b2", {0, 1, 2, 3, 4, 5, 6}, {kNothing, 1, kNothing, kNothing, 2, 3, kNothing}},
      {"nothing", "#d55e00", {0, 1}, {kNothing, kNothing}},
      {"last", "#009e73", {7, 8}, {4, 5}}};
  const Result<OutputFolder> folder = OutputFolder::open(in("out"));
  ASSERT_TRUE(folder.ok());
  const Figure figure = draw(chart, *folder);
  const std::string data = file_text(in("out/gaps.dat"));
  std::vector<std::string> blocks;
  for (std::size_t at = 0; at < data.size();) {
    const std::size_t end = std::min(data.find("\n\n\n", at), data.size());
    blocks.push_back(data.substr(at, end - at));
    at = end + 3;
  }
  ASSERT_EQ(blocks.size(), 3u) << data;
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_TRUE(blocks[i].starts_with("# " + chart.series[i].label)) << blocks[i];
    EXPECT_EQ(blocks[i].find("\n\n"), std::string::npos) << "a blank line within a series: " << blocks[i];
  }
  if (figure.svg.empty()) GTEST_SKIP() << "gnuplot is not here";
  EXPECT_NE(figure.svg.find(">last<"), std::string::npos);
}

TEST(Manifests, HoldThePrintedValues) {
  const auto manifests = manifests_for("");
  ASSERT_TRUE(manifests.ok()) << manifests.error().message();
  const auto table = [&](int number) -> const Manifest& {
    const auto at = std::find_if(manifests->begin(), manifests->end(),
                                 [&](const Manifest& m) { return m.table == number; });
    EXPECT_NE(at, manifests->end()) << "table " << number;
    return *at;
  };
  ASSERT_GE(manifests->size(), 8u);
  EXPECT_TRUE(table(6).kind == Manifest::Kind::kNeighbours);
  EXPECT_TRUE(table(11).kind == Manifest::Kind::kMethods);
  EXPECT_TRUE(table(3).kind == Manifest::Kind::kMeshes);
  EXPECT_EQ(table(3).printed_meshes.size(), 8u);
  for (const PrintedMesh& printed : table(3).printed_meshes) {
    EXPECT_FALSE(printed.minutes.empty()) << printed.method;
    EXPECT_TRUE(printed.ours.empty() ||
                std::any_of(table(3).models.begin(), table(3).models.end(),
                            [&](const ManifestModel& m) { return m.name == printed.ours; }))
        << printed.method;
  }
  EXPECT_EQ(table(11).methods.size(), 12u);
  for (const ManifestMethod& method : table(11).methods)
    EXPECT_EQ(method.published.size(), method.renderer == "mls-penalty"     ? 2u
                                       : method.renderer == "cloud-literal" ? 3u
                                       : method.renderer == "vgraph"        ? 1u
                                                                            : 0u)
        << method.renderer;
  EXPECT_EQ(table(7).printed_frames, 54717u);
  EXPECT_EQ(table(7).printed_mean_ms, 0.0374);
  EXPECT_EQ(table(8).printed_frames, 49914u);
  EXPECT_EQ(table(8).printed_mean_ms, 0.0358);
  EXPECT_EQ(table(9).contact_frames, 116013u);
  EXPECT_EQ(table(10).printed_frames, 258229u);
  EXPECT_EQ(table(10).printed_mean_ms, 0.0459);
  EXPECT_EQ(table(12).printed_mean_ms, 0.0158);
  EXPECT_EQ(table(13).printed_frames, 32597u);
  EXPECT_FALSE(table(13).models[0].stand_in.empty());
  // Every scene that a manifest names is there and is one.
  for (const Manifest& m : *manifests)
    for (const ManifestModel& model : m.models)
      for (const std::string& name : {model.scene, model.stand_in}) {
        if (name.empty()) continue;
        const auto scenes = embedded_scenes();
        const auto at = std::find_if(scenes.begin(), scenes.end(),
                                     [&](const EmbeddedManifest& scene) { return name == scene.name; });
        ASSERT_NE(at, scenes.end()) << name;
        const auto scene = scene::parse_scene(at->text, name);
        EXPECT_TRUE(scene.ok()) << scene.error().message();
      }
  const render::Registry registry = all_renderers();
  for (const Manifest& m : *manifests)
    for (const ManifestRun& run : m.runs) {
      const bool baseline = run.renderer.rfind("mesh-", 0) == 0;
      if (baseline && registry.find("mesh-godobject") == nullptr) continue;  // built without the baselines
      const auto requests = parse_renderers(run.renderer, registry);
      EXPECT_TRUE(requests.ok()) << requests.error().message();
    }
  const auto chosen = manifests_for("9,7,9");
  ASSERT_TRUE(chosen.ok());
  EXPECT_EQ(chosen->size(), 2u);
}

TEST(FramesTable, StandsBesideTheThesis) {
  const auto manifests = manifests_for("7");
  ASSERT_TRUE(manifests.ok());
  const std::string text = to_text(frames_table(manifests->front(), document()));
  EXPECT_NE(text.find("54,717"), std::string::npos);
  EXPECT_NE(text.find("37.4"), std::string::npos);
  EXPECT_NE(text.find("1,234"), std::string::npos) << text;
  EXPECT_NE(text.find("Not in the thesis"), std::string::npos) << text;
}

class Folder : public InFolder {};

TEST_F(Folder, IsMadeMarkedAndKeptFromStrangers) {
  const auto made = OutputFolder::open(in("a/b"));
  ASSERT_TRUE(made.ok()) << made.error().message();
  ASSERT_TRUE(made->write("result.json", "{}").ok());
  ASSERT_TRUE(OutputFolder::open(in("a/b")).ok());
  EXPECT_FALSE(std::filesystem::exists(in("a/b/result.json"))) << "old results must not look like new ones";
  EXPECT_FALSE(OutputFolder::open(in("a")).ok()) << "a folder with somebody's files";
}

}  // namespace
}  // namespace palpate::experiments
