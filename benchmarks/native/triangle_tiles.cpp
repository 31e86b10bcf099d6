#include "triangle_tiles.hpp"

#include <algorithm>
#include <cmath>

namespace trailmark {
namespace {

constexpr double kRounding = 1e-9;  // relative; a tile rather holds a triangle too many

}  // namespace

std::shared_ptr<Mesh> mesh_of(const std::vector<Triangle>& triangles) {
  auto mesh = std::make_shared<Mesh>();
  mesh->beginModel(static_cast<int>(triangles.size()), static_cast<int>(3 * triangles.size()));
  for (const Triangle& t : triangles) {
    mesh->addTriangle({t[0][0], t[0][1], 0.0}, {t[1][0], t[1][1], 0.0}, {t[2][0], t[2][1], 0.0});
  }
  mesh->endModel();
  mesh->computeLocalAABB();
  return mesh;
}

TriangleTiles::TriangleTiles(const Problem& problem, std::size_t most, double margin)
    : x0_(problem.bounds[0]), y0_(problem.bounds[1]) {
  const double width = problem.bounds[2] - x0_, height = problem.bounds[3] - y0_;
  const double size = std::max(problem.robot.circumradius, std::max(width, height) / static_cast<double>(most));
  per_metre_ = 1.0 / size;
  columns_ = std::max<std::size_t>(1, static_cast<std::size_t>(std::ceil(width / size)));
  rows_ = std::max<std::size_t>(1, static_cast<std::size_t>(std::ceil(height / size)));
  const double reach = problem.robot.circumradius + margin + 2.0 * problem.tolerance +
                       kRounding * (std::abs(x0_) + std::abs(y0_) + width + height);

  std::vector<std::vector<Triangle>> members(columns_ * rows_);
  for (const Triangle& t : problem.triangles) {
    const auto [xmin, xmax] = std::minmax({t[0][0], t[1][0], t[2][0]});
    const auto [ymin, ymax] = std::minmax({t[0][1], t[1][1], t[2][1]});
    for (std::size_t i = row(ymin - reach); i <= row(ymax + reach); ++i) {
      for (std::size_t j = column(xmin - reach); j <= column(xmax + reach); ++j) {
        members[i * columns_ + j].push_back(t);
      }
    }
  }
  for (const std::vector<Triangle>& triangles : members) {
    tiles_.push_back(triangles.empty() ? nullptr : mesh_of(triangles));
  }
}

}  // namespace trailmark
