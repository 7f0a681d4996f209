// Tables, headlines and the page are pure functions of results.
#include <png.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <sstream>

#include "experiments/report/figures.h"
#include "experiments/report/findings.h"
#include "experiments/report/fronts.h"
#include "experiments/report/page.h"
#include "experiments/tables/manifest.h"
#include "experiments/tables/reproduction.h"
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
  r.frame->mean_us = r.frame->mean_clocked_us = mean_us;
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

TEST(ComparisonTable, MarksTheBestOfARow) {
  const Table table = comparison_table(document());
  ASSERT_EQ(table.columns.size(), 3u);
  bool found = false;
  for (const auto& row : table.rows) {
    EXPECT_TRUE(row.size() <= 1 || row.size() == 3u) << row.size();
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
  const std::string text = to_text(comparison_table(d), 100);
  EXPECT_THAT(text, HasAll("did not finish", "preparation stopped after 3 s"));
  bool said = false;
  for (const Headline& line : headlines_of(d))
    said = said || line.text.find("did not finish") != std::string::npos;
  EXPECT_TRUE(said);
}

TEST(Headlines, SayWhoKeepsContactAndRankTheOthers) {
  std::string all;
  for (const Headline& line : headlines_of(document())) all += line.lead + ": " + line.text + "\n";
  EXPECT_THAT(all, HasAll("Contact: right with cloud: nothing missed, false or stuck",
                          "wrong with cloud-literal: 1,234 frames of false contact",
                          "Mean frame in contact: cloud 0.200 µs, cloud-literal 1.50 µs (7.50 times)"));
}

TEST(Headlines, SayTheSameFaultOnce) {
  metrics::ResultDocument d = document();
  d.renderers.push_back(result("twin", 1.0, 90.0, 1234));
  std::string all;
  for (const Headline& line : headlines_of(d)) all += line.text;
  EXPECT_THAT(all, HasSubstr("wrong with cloud-literal and twin: 1,234"));
}

TEST(Page, EscapesWhatItIsGiven) {
  Page page = begin_page("A <title>", document());
  page.headlines = {{"<b>", {{"<script>", "<script>alert(1)</script>"}}}};
  page.sections.push_back({"s", "Section", {}, {document().path}, {comparison_table(document())}, {}, {}});
  const std::string html = to_html(page);
  EXPECT_THAT(html, Not(HasSubstr("<script")));
  EXPECT_THAT(html, HasSubstr("tap &lt;&amp;&gt;"));
  EXPECT_THAT(html, Not(HasSubstr("<b>")));
  EXPECT_THAT(html, HasSubstr("A &lt;title&gt;"));
}

TEST(Warnings, StandOnTheTerminalAndBelowTheAnswerOfThePage) {
  metrics::ResultDocument d = document();
  d.warnings = {"The path never touches <the> model."};
  d.notes = {"There is no ground truth."};
  d.renderers[0].prepare->warnings = d.renderers[1].prepare->warnings = {"The mesh is in 900 pieces."};
  const std::string text = findings_text(d);
  EXPECT_EQ(text,
            "palpate: warning: The path never touches <the> model.\n"
            "palpate: warning: cloud, cloud-literal: The mesh is in 900 pieces.\n"
            "palpate: note: There is no ground truth.\n");
  Page page = begin_page("title", d);
  add_known(page, known_of("Table 7", d));
  page.headlines.push_back({"Heading of the findings", headlines_of(d)});
  const std::string html = to_html(page);
  const std::size_t path = html.find("Table 7: The path never touches &lt;the&gt; model.");
  const std::size_t mesh = html.find("Table 7: cloud, cloud-literal: The mesh is in 900 pieces.");
  const std::size_t note = html.find("Table 7: There is no ground truth.");
  ASSERT_NE(note, std::string::npos) << html;
  EXPECT_LT(path, mesh);
  EXPECT_LT(mesh, note) << "warnings first";
  EXPECT_LT(html.find("Heading of the findings"), path) << "after what was found";
  EXPECT_EQ(to_html(begin_page("title", d)).find("id=\"known\""), std::string::npos) << "none, no box";
}

TEST(FirstPage, AnswersBeforeItExplains) {
  metrics::ResultDocument d = document();
  for (metrics::RendererResult& r : d.renderers) {
    r.accuracy->force_rms_percent = 2.5;
    r.frame_all = r.frame;
  }
  d.renderers[0].role = render::Role::kOurs;
  d.renderers[1].role = render::Role::kLiteral;
  d.renderers[1].missing = {"dents"};
  d.warnings = {"doubtful"};
  Page page = begin_page("title", d);
  page.apart = true;
  page.answers = {answer_of(d)};
  page.tables = {summary_table(d)};
  page.figures = {{"f", "The picture", "a caption", "<svg></svg>", true}};
  add_known(page, known_of("", d));
  page.sections.push_back({"details", "The details", {}, {"A paragraph."}, {comparison_table(d)}, {}, {}});
  const std::string html = to_html(page);
  const std::size_t answer = html.find("<dt>Take</dt>"), table = html.find("<table"),
                    picture = html.find("The picture"), known = html.find("id=\"known\"");
  ASSERT_NE(known, std::string::npos) << html;
  EXPECT_LT(answer, table);
  EXPECT_LT(table, picture);
  EXPECT_LT(picture, known);
  EXPECT_NE(html.find("<a href=\"details.html\">The details</a>"), std::string::npos);
  EXPECT_EQ(html.find("All scores"), std::string::npos) << "that is on the other page";
  for (const char* said :
       {"what it is", "force error, RMS, %", "contact", "ready after", "bytes a point", "2.50", ">right<",
        "1,234 frames of false contact", "0.200", "100 ms", ">48.0", ">ours<", "as printed; without dents"})
    EXPECT_NE(html.find(said), std::string::npos) << said << "\n" << html;
  const std::string details = section_page(page, page.sections[0]);
  EXPECT_NE(details.find("All scores"), std::string::npos);
  EXPECT_NE(details.find("<a href=\"report.html\">"), std::string::npos);
}

TEST(FirstPage, SaysWhatThereIsWhereForcesOrTruthAreMissing) {
  metrics::ResultDocument d = document();
  for (metrics::RendererResult& r : d.renderers) r.accuracy->force_rms_n.reset();
  EXPECT_EQ(summary_table(d).rows[0][2].text, kMissingNumber);
  EXPECT_EQ(trade_chart("t", d).x_label, "preparation, ms") << "nothing is said of the force";
  EXPECT_TRUE(has_points(trade_chart("t", d)));
  for (metrics::RendererResult& r : d.renderers) r.accuracy.reset();
  for (const auto& row : summary_table(d).rows)
    EXPECT_EQ(row[3].text, kMissingNumber) << "no truth, no word on contact";
  d.renderers[1].status = metrics::RunStatus::kFailed;
  d.renderers[1].reason = "no <mesh>";
  d.renderers[1].frame.reset();
  EXPECT_EQ(summary_table(d).rows[1][6].text, "failed");
  EXPECT_EQ(headlines_of(d)[0].text, "cloud-literal failed: no <mesh>.");
  for (metrics::RendererResult& r : d.renderers) r.frame.reset();
  EXPECT_FALSE(has_points(trade_chart("t", d))) << "nothing to draw";
  EXPECT_TRUE(summary_table({}).rows.empty());
}

/// A frames-table of the thesis, measured: literal, ours, mesh.
metrics::ResultDocument measured_table() {
  metrics::ResultDocument d = document();
  d.renderers.push_back(result("mesh-godobject", 0.3, 900.0, 0));
  d.renderers[0].role = render::Role::kOurs;
  d.renderers[1].role = render::Role::kLiteral;
  d.renderers[2].works_on = render::Geometry::kMesh;
  for (metrics::RendererResult& r : d.renderers) {
    r.model->points = 1'002'001;
    r.frame_all = r.frame;
    r.accuracy->force_rms_percent = 0.5;
  }
  return d;
}

TEST(Answers, FollowFromTheNumbers) {
  const Manifest manifest = manifests_for("7")->front();
  metrics::ResultDocument d = measured_table();
  const Answer part = frames_answer(manifest, d);
  EXPECT_EQ(part.printed, "37.4 µs, dual Xeon 2.8 GHz, 2 GB (2008)");
  EXPECT_EQ(part.ours, "cloud 0.200 µs");
  EXPECT_NEAR(part.ratio, 187.0, 1e-9);
  EXPECT_EQ(part.error, "0.500 %");
  EXPECT_EQ(part.mesh_error, "0.500 %");
  EXPECT_EQ(part.take, "cloud");
  EXPECT_EQ(part.status, "in part: as fast; as printed 1,234 frames of wrong contact, made right none");
  EXPECT_TRUE(part.reproduced == Judged::kNo && part.as_fast == Judged::kYes);
  d.renderers[1].accuracy->false_contact_frames = d.renderers[1].accuracy->longest_stick_frames = 0;
  const Answer whole = frames_answer(manifest, d);
  EXPECT_EQ(whole.status, "reproduced");
  const std::vector<Headline> verdicts = verdicts_of({part, whole});
  ASSERT_EQ(verdicts.size(), 2u);
  EXPECT_NE(verdicts[0].text.find("Its times are reproduced: all 2"), std::string::npos) << verdicts[0].text;
  EXPECT_NE(
      verdicts[0].text.find("right in 1 of 2 tables with the algorithm as printed, in all 2 made right"),
      std::string::npos)
      << verdicts[0].text;
  EXPECT_TRUE(verdicts[1].text.starts_with("cloud (tables 7, 7): ")) << verdicts[1].text;
  EXPECT_EQ(verdicts_of({whole})[0].text,
            "Table 7 alone was measured at its size: reproduced, ours 187 times faster.");
  d.renderers[1].frame->mean_us = 40.0;
  EXPECT_EQ(frames_answer(manifest, d).status, "not reproduced: slower than printed");
  d.renderers[0].accuracy->missed_contact_frames = 3;
  d.renderers[1].frame->mean_us = 1.0;
  EXPECT_EQ(frames_answer(manifest, d).status, "in part: contact is wrong, 3 frames of wrong contact");
  // A small part of the model is not held against the whole of the thesis.
  for (metrics::RendererResult& r : d.renderers) r.model->points = 10'201;
  const Answer tried = frames_answer(manifest, d);
  EXPECT_EQ(tried.status, "tried on a small model only");
  EXPECT_TRUE(tried.ratio == 0.0 && tried.reproduced == Judged::kNot && tried.ours_right == Judged::kNot);
  EXPECT_TRUE(verdicts_of({tried})[0].text.starts_with("Not judged")) << verdicts_of({tried})[0].text;
}

TEST(Answers, StandBeforeTheReasonsAndLeadToAPageEach) {
  const Manifest manifest = manifests_for("7")->front();
  Part part{{}, {}, {frames_answer(manifest, measured_table())}, {"table 3, bunny: not here"}, false};
  part.sections.push_back(
      {"table7", "Table 7", {}, {}, {}, {{"table7-trade", "Time", "", "<svg></svg>", true}}, {}});
  const std::string html = to_html(page_of({}, {part}));
  const std::size_t verdict = html.find("<dt>The thesis</dt>"), row = html.find("table7.html\">7</a>"),
                    picture = html.find("<svg>"), missing = html.find("not here");
  ASSERT_NE(row, std::string::npos) << html;
  EXPECT_LT(verdict, row);
  EXPECT_LT(row, picture);
  EXPECT_LT(picture, missing);
}

TEST(Roles, DecideWhoCompetesAndNotNames) {
  metrics::ResultDocument d = document();
  d.renderers[0].label = "mine";
  d.renderers[0].role = render::Role::kReference;
  d.renderers[1].name = "analytic";
  EXPECT_FALSE(competes(d.renderers[0]));
  EXPECT_TRUE(competes(d.renderers[1]));
  const Table table = comparison_table(d);
  EXPECT_TRUE(std::any_of(table.notes.begin(), table.notes.end(), [](const std::string& note) {
    return note == "Shown to compare with, and not marked as best: mine.";
  }));
}

/// A square of points with a path over it that one renderer gets wrong.
Study small_study() {
  Study study;
  study.document = document();
  study.document.models = {{"square", "square", "0123456789abcdef", 900, "model-1.csv"}};
  std::vector<Vec3> points;
  for (int i = 0; i < 30; ++i)
    for (int k = 0; k < 30; ++k) points.emplace_back(i, k, 0.1 * i);
  study.models = {{"square", *cloud::build_cloud(points, cloud::NonFinite::kRefuse)}};
  for (int i = 0; i < 100; ++i) {
    study.path.t_s.push_back(0.001 * i);
    study.path.hip_mm.emplace_back(0.3 * i, 15.0, 0.0);
  }
  for (std::size_t r = 0; r < 2; ++r) {
    metrics::AccuracyFrames frames;
    frames.force_error_n.assign(100, r == 0 ? 0.0f : 10.0f);
    frames.missed_contact.assign(100, 0);
    frames.false_contact.assign(100, r == 0 ? 0 : 1);
    study.runs.push_back({{}, frames});
  }
  return study;
}

TEST(ModelFigure, ShowsTheModelThePathAndWhatIsWrong) {
  Study study = small_study();
  const Figure figure = model_figure(study, "s");
  EXPECT_THAT(figure.svg, HasSubstr("href=\"data:image/png;base64,iVBOR"));
  EXPECT_LT(figure.svg.size(), 200'000u);
  EXPECT_EQ(model_figure(study, "s").svg, figure.svg) << "drawn twice, the same picture";
  const std::size_t right = figure.svg.find(">cloud<"), wrong = figure.svg.find(">cloud-literal<");
  ASSERT_LT(right, wrong);
  const auto drawn = [](const std::string& panel, const char* colour) {
    return panel.find(std::string("stroke=\"") + colour) != std::string::npos;
  };
  EXPECT_FALSE(drawn(figure.svg.substr(right, wrong - right), "#8b1a1a")) << "an error where there is none";
  EXPECT_TRUE(drawn(figure.svg.substr(wrong), "#8b1a1a"));
  EXPECT_TRUE(drawn(figure.svg.substr(wrong), "#7b2cbf")) << "false contact";
  // Without a truth one panel, and no legend of errors.
  for (StudyRun& run : study.runs) run.per_frame = {};
  const Figure alone = model_figure(study, "s");
  EXPECT_THAT(alone.svg, Not(HasSubstr("false contact")));
  EXPECT_THAT(alone.caption, HasSubstr("no ground truth"));
  study.models.clear();
  EXPECT_TRUE(model_figure(study, "s").svg.empty());
}

TEST(ModelView, ShowsAllOfABoxAndWhatIsNearInFront) {
  for (const double size : {1e-3, 1.0, 1e6}) {
    geometry::Aabb box;
    box.add(Vec3(size, size, size));
    box.add(Vec3(3 * size, 2 * size, 1.5 * size));
    const ModelView view(box, 300, 200);
    for (const double x : {1.0, 3.0})
      for (const double y : {1.0, 2.0})
        for (const double z : {1.0, 1.5}) {
          const ModelView::Seen seen = view.seen(size * Vec3(x, y, z));
          EXPECT_TRUE(seen.x > 0 && seen.x < 300 && seen.y > 0 && seen.y < 200) << seen.x << " " << seen.y;
        }
    EXPECT_GT(view.seen(size * Vec3(2, 2, 2)).near_mm, view.seen(size * Vec3(2, 2, 1)).near_mm);
    EXPECT_LT(view.seen(size * Vec3(2, 2, 2)).y, view.seen(size * Vec3(2, 2, 1)).y) << "up is up";
  }
  geometry::Aabb point;
  point.add(Vec3(5, 5, 5));
  EXPECT_EQ(ModelView(point, 300, 200).seen({5, 5, 5}).x, 150.0);
}

TEST(Png, HoldsThePixels) {
  GreyImage image{3, 2, {0, 255, 7, 7, 7, 130}};
  const std::string png = png_of(image);
  ASSERT_TRUE(png.starts_with("\x89PNG\r\n\x1a\n")) << png.size();
  png_image read{};
  read.version = PNG_IMAGE_VERSION;
  ASSERT_TRUE(png_image_begin_read_from_memory(&read, png.data(), png.size())) << read.message;
  EXPECT_EQ(read.width, 3u);
  EXPECT_EQ(read.height, 2u);
  read.format = PNG_FORMAT_GRAY;
  std::vector<std::uint8_t> pixels(PNG_IMAGE_SIZE(read));
  ASSERT_TRUE(png_image_finish_read(&read, nullptr, pixels.data(), 0, nullptr)) << read.message;
  EXPECT_EQ(pixels, image.pixels);
  EXPECT_EQ(png_of({}), "");
}

TEST(Base64, IsThatOfTheStandard) {
  for (const auto& [plain, coded] :
       {std::pair{"", ""}, {"f", "Zg=="}, {"fo", "Zm8="}, {"foo", "Zm9v"}, {"foobar", "Zm9vYmFy"}})
    EXPECT_EQ(base64(plain), coded);
}

class Charts : public InFolder {
 protected:
  Figure drawn(const Chart& chart) { return draw(chart, out_); }
  OutputFolder out_ = OutputFolder::open(in("out")).value();
};

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
  ASSERT_TRUE(out_.begin("a").ok());
  const Figure figure = drawn(chart);
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
    EXPECT_THAT(blocks[i], Not(HasSubstr("\n\n"))) << "a blank line within a series: ";
  }
  if (figure.svg.empty()) GTEST_SKIP() << "gnuplot is not here";
  EXPECT_THAT(figure.svg, HasSubstr(">last<"));
}

TEST_F(Charts, WithoutAPointSaySo) {
  Chart chart;
  chart.name = "empty";
  chart.log_y = true;
  chart.nothing = "No force is wrong.";
  chart.series = {{"exact", "#0072b2", {0, 1}, {std::nan(""), std::nan("")}}, {"failed", "#d55e00", {}, {}}};
  EXPECT_EQ(drawn(chart).caption, "No force is wrong.") << "not gnuplot's words for it";
  EXPECT_TRUE(drawn(chart).svg.empty());
}

TEST_F(Charts, LogarithmicAxesWithinADecadeAreLabelled) {
  Chart chart;
  chart.name = "decade";
  chart.log_x = chart.log_y = true;
  chart.series = {{"narrow and wide", "#0072b2", {2.1, 3.9}, {0.01, 10.0}}};
  ASSERT_TRUE(out_.begin("a").ok());
  (void)drawn(chart);
  const std::string script = file_text(in("out/decade.gp"));
  EXPECT_THAT(script, HasSubstr("set xtics (1e0, 1.5e0, 2e0, 3e0, 5e0, 7e0, 1e1, "));
  EXPECT_THAT(script, Not(HasSubstr("set ytics")));
}

TEST_F(Charts, PanelsLeaveOutWhoDidNotRun) {
  Chart chart;
  chart.name = "panels";
  chart.style = Chart::Style::kPanels;
  chart.log_y = true;
  chart.series = {{"least", "#c4c4c4", {0, 1, 2}, {1e-3, 2e-3, 1e-4}}};
  for (int i = 0; i < 9; ++i)
    chart.series.push_back({"renderer-" + std::to_string(i), "#0072b2", {0, 1, 2}, {0.1, 0.2, 0.3}});
  chart.series[4] = {"failed", "#d55e00", {}, {}};
  const Figure figure = drawn(chart);
  if (figure.svg.empty()) GTEST_SKIP() << "gnuplot is not here: " << figure.caption;
  EXPECT_THAT(figure.svg, HasSubstr(">renderer-8<"));
  EXPECT_THAT(figure.svg, Not(HasSubstr(">failed<")));
}

TEST_F(Charts, WhatLeavesAPanelRunsAlongItsEdge) {
  Chart chart;
  chart.name = "edges";
  chart.caption = "Force.";
  chart.style = Chart::Style::kPanels;
  chart.series = {{"truth", "#c4c4c4", {0, 1, 2}, {0, 1, 0}}, {"mild", "#0072b2", {0, 1, 2}, {0, 1.1, 0}}};
  if (drawn(chart).svg.empty()) GTEST_SKIP() << "gnuplot is not here";
  EXPECT_EQ(drawn(chart).caption, "Force.");
  chart.series.push_back({"wild", "#d55e00", {0, 1, 2}, {50, 60, 70}});
  EXPECT_EQ(drawn(chart).caption, "Force. What leaves a panel runs along its edge.");
}

bool same_look(const LineStyle& a, const LineStyle& b) {
  return a.colour == b.colour && a.dash == b.dash;
}

TEST(Looks, NoTwoRenderersLookAlike) {
  std::vector<std::string> labels = {"mesh-godobject", "analytic", "cloud"};
  for (int i = 0; i < 25; ++i) labels.push_back("renderer-" + std::to_string(i));
  const std::vector<LineStyle> styles = line_styles_of(labels);
  ASSERT_EQ(styles.size(), labels.size());
  for (std::size_t i = 0; i < styles.size(); ++i)
    for (std::size_t k = 0; k < i; ++k)
      EXPECT_FALSE(same_look(styles[i], styles[k])) << labels[i] << " and " << labels[k];
  EXPECT_EQ(line_styles_of({"cloud"})[0].dash, "");
  const std::vector<LineStyle> again = line_styles_of({labels.rbegin(), labels.rend()});  // in another order
  for (std::size_t i = 0; i < styles.size(); ++i)
    EXPECT_TRUE(same_look(again[styles.size() - 1 - i], styles[i])) << labels[i];
}

TEST(Looks, ARendererHasOneBesideAnyOther) {
  std::vector<std::string> names = {"ab"};  // the first in the alphabet, and no renderer
  const render::Registry registry = all_renderers();
  for (const render::RendererInfo& info : registry.all()) names.push_back(info.name);
  const auto together = line_styles_of(names);
  for (std::size_t i = 1; i < names.size(); ++i)
    EXPECT_TRUE(same_look(line_styles_of({names[i]})[0], together[i])) << names[i];
}

TEST(Looks, NoColourIsSharedWhileThereAreOthers) {
  std::vector<std::string> labels = {"cloud", "cloud-smooth", "cloud-literal", "mesh-godobject"};
  for (const char* label : {"cloud-bare", "cloud-exact", "own", "own-faster", "bare"}) {
    labels.emplace_back(label);
    std::set<std::string> colours;
    for (const LineStyle& style : line_styles_of(labels)) colours.insert(style.colour);
    EXPECT_EQ(colours.size(), labels.size()) << label;
  }
}

TEST_F(Charts, MarksOfEveryStyleDiffer) {
  Chart chart;
  chart.name = "marks";
  chart.style = Chart::Style::kMarks;
  std::vector<std::string> labels;
  for (int i = 0; i < 25; ++i) labels.push_back("setting-" + std::to_string(i));
  for (const LineStyle& style : line_styles_of(labels))
    chart.series.push_back({"a", style.colour, {1}, {1}, style.dash, false, {{1, 1, 1, 1}}});
  ASSERT_TRUE(out_.begin("a").ok());
  (void)drawn(chart);
  std::set<std::string> looks;
  std::istringstream script(file_text(in("out/marks.gp")));
  for (std::string line; std::getline(script, line);)
    if (const std::size_t at = line.find("xyerrorbars"); at != std::string::npos)
      looks.insert(line.substr(at, line.find(" title") - at));
  EXPECT_EQ(looks.size(), 25u);
}

TEST(FramesTable, StandsBesideTheThesis) {
  const auto manifests = value_of(manifests_for("7"));
  const std::string text = to_text(frames_table(manifests.front(), document()), 100);
  EXPECT_THAT(text, HasAll("54,717", "37.4", "1,234", "Not in the thesis"));
}

}  // namespace
}  // namespace palpate::experiments
