#include "problem.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

namespace trailmark {
namespace {

using Json = nlohmann::json;

constexpr int kVersion = 2;

std::vector<Triangle> triangles_of(const Json& rows) {
  std::vector<Triangle> triangles;
  triangles.reserve(rows.size());
  for (const Json& row : rows) {
    const auto v = row.get<std::array<double, 6>>();
    triangles.push_back({{{v[0], v[1]}, {v[2], v[3]}, {v[4], v[5]}}});
  }
  return triangles;
}

Disc disc_of(const Json& row) {
  const auto v = row.get<std::array<double, 3>>();
  return {{v[0], v[1]}, v[2]};
}

Robot robot_of(const Json& entry) {
  Robot robot;
  robot.round = entry.at("shape") == "disc";
  robot.radius = robot.round ? entry.at("radius").get<double>() : 0.0;
  if (!robot.round) {
    robot.triangles = triangles_of(entry.at("triangles"));
    robot.hull = entry.at("hull").get<std::vector<Point>>();
    if (robot.triangles.empty() || robot.hull.size() < 3) {
      throw std::runtime_error("robot: no triangles or no hull given");
    }
  }
  robot.circumradius = entry.at("circumradius").get<double>();
  robot.inscribed = disc_of(entry.at("inscribed"));
  robot.turning_radius = entry.at("turning_radius").get<double>();
  robot.reverse = entry.at("reverse").get<bool>();
  return robot;
}

}  // namespace

Problem read_problem(std::istream& stream) {
  try {
    const Json entry = Json::parse(stream);
    if (entry.at("trailmark_native") != kVersion) {
      throw std::runtime_error("version " + entry.at("trailmark_native").dump() + " given, allowed: " + std::to_string(kVersion));
    }
    Problem problem;
    problem.bounds = entry.at("bounds").get<std::array<double, 4>>();
    problem.tolerance = entry.at("tolerance").get<double>();
    problem.triangles = triangles_of(entry.at("triangles"));
    for (const Json& row : entry.at("discs")) {
      problem.discs.push_back(disc_of(row));
    }
    problem.robot = robot_of(entry.at("robot"));
    problem.start = entry.at("start").get<Configuration>();
    problem.goal = entry.at("goal").get<Configuration>();
    return problem;
  } catch (const std::exception& error) {
    std::string text = error.what();
    std::replace(text.begin(), text.end(), '\n', ' ');
    throw std::runtime_error("problem: " + text);
  }
}

}  // namespace trailmark
