#pragma once

#include <algorithm>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Sparse>

namespace lazyloc {

// Solves the reduced camera system of bundle adjustment: the normal equations of the frames after the points have been
// eliminated. Its lower triangle consists of kSize x kSize blocks (a, b), b <= a, one for each two frames that observe
// a common point. Blocks are stored one after the other, because in a matrix each would be scattered over many cache
// lines.
//
// Up to 150 frames are solved by a dense matrix, more by a sparse one, because in a large group, for example along a
// path, most pairs of frames have no point in common.
template <int kSize>
class CameraSystem {
 public:
  using Matrix = Eigen::Matrix<double, kSize, kSize>;
  using Blocks = std::vector<Matrix>;

  explicit CameraSystem(size_t num_frames) : columns_of_row_(num_frames) {}
  bool IsDense() const { return NumFrames() <= kMaxNumDenseFrames; }

  // Makes blocks for frames that observe a common point. frames: ascending; a frame may occur twice.
  void AddPoint(const std::vector<int>& frames);
  // Computes where the blocks are stored. Call it once, after the last point.
  void Finish();

  void SetZero(Blocks* blocks) const { blocks->assign(num_blocks_, Matrix::Zero()); }

  // Returns the block of two frames that observe a common point, b <= a.
  Matrix& Block(int a, int b, Blocks* blocks) const {
    if (IsDense()) return (*blocks)[first_block_of_row_[a] + b];
    const std::vector<int>& columns = columns_of_row_[a];
    return (*blocks)[first_block_of_row_[a] + (std::lower_bound(columns.begin(), columns.end(), b) - columns.begin())];
  }

  // Returns the block of two frames, b <= a; null if they observe no common point.
  const Matrix* FindBlock(int a, int b, const Blocks& blocks) const {
    const std::vector<int>& columns = columns_of_row_[a];
    const auto column = std::lower_bound(columns.begin(), columns.end(), b);
    if (column == columns.end() || *column != b) return nullptr;
    return &blocks[first_block_of_row_[a] + (column - columns.begin())];
  }

  // Returns the lower triangle of the equations of some frames, in their order.
  Eigen::MatrixXd EquationsOf(const std::vector<int>& frames, const Blocks& blocks) const;

  // Computes the Cholesky factor that the functions below need. Returns false if the matrix is not positive definite.
  bool Factorize(const Blocks& blocks);
  bool HasFactor() const { return (IsDense() ? dense_.info() : sparse_.info()) == Eigen::Success; }

  Eigen::VectorXd Solve(const Eigen::VectorXd& rhs) const;
  Eigen::MatrixXd ColumnsOfInverse(int frame) const;
  std::vector<Matrix> DiagonalOfInverse() const;

 private:
  static constexpr Eigen::Index kMaxNumDenseFrames = 150;

  Eigen::Index NumFrames() const { return static_cast<Eigen::Index>(columns_of_row_.size()); }
  // Return the lower triangle of the matrix.
  Eigen::MatrixXd Dense(const Blocks& blocks) const;
  Eigen::SparseMatrix<double> Sparse(const Blocks& blocks) const;
  std::vector<Matrix> DiagonalOfSparseInverse() const;

  std::vector<std::vector<int>> columns_of_row_;
  std::vector<size_t> first_block_of_row_;
  size_t num_blocks_ = 0;
  Eigen::LLT<Eigen::MatrixXd> dense_;
  Eigen::SimplicialLLT<Eigen::SparseMatrix<double>> sparse_;
  bool is_analyzed_ = false;
};

}  // namespace lazyloc
