#pragma once

#include <algorithm>
#include <numeric>
#include <optional>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Sparse>

#include "colmap_lazyloc/math/selected_inverse.h"

namespace lazyloc {

// Solves the reduced camera system of bundle adjustment, whose lower triangle is made of kSize x kSize blocks (a, b),
// one for each two cameras b <= a that see a common point. They stand side by side: as a matrix, each would be spread
// over many cache lines. Few cameras are taken to see all others, and solved by a dense matrix; of many, as a group of
// queries along a path has them, the system is sparse.
template <int kSize>
class CameraSystem {
 public:
  using Matrix = Eigen::Matrix<double, kSize, kSize>;
  using Blocks = std::vector<Matrix>;

  explicit CameraSystem(size_t num_cameras) : columns_of_row_(num_cameras) {}

  // Says that cameras see a common point; they ascend.
  void AddPoint(const std::vector<int>& cameras) {
    if (IsDense()) return;
    for (const int a : cameras) {
      std::vector<int>& columns = columns_of_row_[a];
      for (const int b : cameras) {
        if (b > a) break;
        const auto at = std::lower_bound(columns.begin(), columns.end(), b);
        if (at == columns.end() || *at != b) columns.insert(at, b);
      }
    }
  }

  // Once, after the last point.
  void Finish() {
    for (size_t row = 0; row < columns_of_row_.size() && IsDense(); ++row) {
      columns_of_row_[row].resize(row + 1);
      std::iota(columns_of_row_[row].begin(), columns_of_row_[row].end(), 0);
    }
    for (size_t row = 0; row < columns_of_row_.size(); ++row) {
      std::vector<int>& columns = columns_of_row_[row];
      if (columns.empty() || columns.back() != static_cast<int>(row)) columns.push_back(static_cast<int>(row));
      first_block_of_row_.push_back(num_blocks_);
      num_blocks_ += columns.size();
    }
  }

  void SetZero(Blocks* blocks) const { blocks->assign(num_blocks_, Matrix::Zero()); }

  Matrix& Block(int a, int b, Blocks* blocks) const {
    if (IsDense()) return (*blocks)[first_block_of_row_[a] + b];
    const std::vector<int>& columns = columns_of_row_[a];
    return (*blocks)[first_block_of_row_[a] + (std::lower_bound(columns.begin(), columns.end(), b) - columns.begin())];
  }

  // False where the matrix is not positive definite.
  bool Factorize(const Blocks& blocks) {
    if (IsDense()) {
      dense_.compute(Dense(blocks));
      return dense_.info() == Eigen::Success;
    }
    const Eigen::SparseMatrix<double> matrix = Sparse(blocks);
    if (!is_analyzed_) sparse_.analyzePattern(matrix);
    is_analyzed_ = true;
    sparse_.factorize(matrix);
    return sparse_.info() == Eigen::Success;
  }

  bool HasFactor() const { return (IsDense() ? dense_.info() : sparse_.info()) == Eigen::Success; }

  // These need a factor.
  Eigen::VectorXd Solve(const Eigen::VectorXd& rhs) const {
    return IsDense() ? Eigen::VectorXd(dense_.solve(rhs)) : Eigen::VectorXd(sparse_.solve(rhs));
  }

  // None of many cameras.
  std::optional<Eigen::MatrixXd> Inverse() const {
    if (!IsDense()) return std::nullopt;
    const Eigen::MatrixXd root = RootOfInverse();
    return Eigen::MatrixXd(root.transpose() * root);
  }

  // The diagonal blocks of the inverse.
  std::vector<Matrix> DiagonalOfInverse() const {
    std::vector<Matrix> diagonal(columns_of_row_.size());
    if (IsDense()) {
      const Eigen::MatrixXd root = RootOfInverse();
      for (size_t a = 0; a < diagonal.size(); ++a) {
        const auto columns = root.template middleCols<kSize>(kSize * a);
        diagonal[a] = columns.transpose() * columns;
      }
      return diagonal;
    }
    const Eigen::SparseMatrix<double> inverse = SelectedInverse(sparse_.matrixL());
    for (size_t a = 0; a < diagonal.size(); ++a) {
      for (int row = 0; row < kSize; ++row) {
        for (int col = 0; col < kSize; ++col) {
          const auto [low, high] = std::minmax(sparse_.permutationP().indices()[kSize * a + row],
                                               sparse_.permutationP().indices()[kSize * a + col]);
          diagonal[a](row, col) = inverse.coeff(high, low);
        }
      }
    }
    return diagonal;
  }

 private:
  static constexpr Eigen::Index kMaxNumDenseCameras = 150;

  Eigen::Index NumCameras() const { return static_cast<Eigen::Index>(columns_of_row_.size()); }
  bool IsDense() const { return NumCameras() <= kMaxNumDenseCameras; }

  // R, where the inverse is R^T R.
  Eigen::MatrixXd RootOfInverse() const {
    const Eigen::Index size = kSize * NumCameras();
    return dense_.matrixL().solve(Eigen::MatrixXd::Identity(size, size));
  }

  // Its lower triangle.
  Eigen::MatrixXd Dense(const Blocks& blocks) const {
    Eigen::MatrixXd matrix(kSize * NumCameras(), kSize * NumCameras());
    size_t block = 0;
    for (size_t a = 0; a < columns_of_row_.size(); ++a) {
      for (const int b : columns_of_row_[a]) {
        matrix.template block<kSize, kSize>(kSize * a, kSize * b) = blocks[block++];
      }
    }
    return matrix;
  }

  Eigen::SparseMatrix<double> Sparse(const Blocks& blocks) const {
    std::vector<Eigen::Triplet<double>> entries;
    entries.reserve(kSize * kSize * num_blocks_);
    size_t block = 0;
    for (size_t a = 0; a < columns_of_row_.size(); ++a) {
      for (const int b : columns_of_row_[a]) {
        for (int col = 0; col < kSize; ++col) {
          for (int row = static_cast<int>(a) == b ? col : 0; row < kSize; ++row) {
            entries.emplace_back(kSize * a + row, kSize * b + col, blocks[block](row, col));
          }
        }
        ++block;
      }
    }
    Eigen::SparseMatrix<double> matrix(kSize * NumCameras(), kSize * NumCameras());
    matrix.setFromTriplets(entries.begin(), entries.end());
    return matrix;
  }

  std::vector<std::vector<int>> columns_of_row_;
  std::vector<size_t> first_block_of_row_;
  size_t num_blocks_ = 0;
  Eigen::LLT<Eigen::MatrixXd> dense_;
  Eigen::SimplicialLLT<Eigen::SparseMatrix<double>> sparse_;
  bool is_analyzed_ = false;
};

}  // namespace lazyloc
