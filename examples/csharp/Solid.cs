// A solid of ldsim as a C# host holds it, Unity for one: Program.cs says how to build and run it. In Unity, put the
// library (libldsim.dll, .so or .dylib) into Assets/Plugins. Arrays are kept and filled again, so that a frame allocates
// nothing; Unity's z axis points the other way, so a host there turns the sign of z and the order of each triangle.
using System;
using System.Runtime.InteropServices;

public sealed class Model : SafeHandle
{
    [DllImport("libldsim")] static extern int ldsim_load(byte[] bytes, UIntPtr size, out IntPtr model);
    [DllImport("libldsim")] static extern void ldsim_free(IntPtr model);
    [DllImport("libldsim")] static extern void ldsim_describe(Model model, out Info info);
    [DllImport("libldsim")] static extern IntPtr ldsim_rest(Model model);
    [DllImport("libldsim")] static extern IntPtr ldsim_triangles(Model model);
    [DllImport("libldsim")] static extern IntPtr ldsim_movable(Model model);
    [DllImport("libldsim")] static extern IntPtr ldsim_message(int code);

    [StructLayout(LayoutKind.Sequential)]
    public struct Info
    {
        public uint Vertices, Triangles, R, Features, Points, Supports;
        public int Condensed;
        public double TimeStep, GravityX, GravityY, GravityZ, Diagonal, Stiffness, Radius;
    }

    public readonly Info About;
    public readonly double[] Rest; // (vertices, 3), metres
    public readonly int[] Triangles, Movable; // (triangles, 3), outward; 0 where pinned

    /// <param name="bytes">of model.ldsim</param>
    public Model(byte[] bytes) : base(IntPtr.Zero, true)
    {
        Check(ldsim_load(bytes, (UIntPtr)bytes.Length, out handle));
        ldsim_describe(this, out About);
        Marshal.Copy(ldsim_rest(this), Rest = new double[3 * About.Vertices], 0, 3 * (int)About.Vertices);
        Marshal.Copy(ldsim_triangles(this), Triangles = new int[3 * About.Triangles], 0, 3 * (int)About.Triangles);
        Marshal.Copy(ldsim_movable(this), Movable = new int[About.Vertices], 0, (int)About.Vertices);
    }

    internal static void Check(int code)
    {
        if (code != 0) throw new InvalidOperationException(Marshal.PtrToStringAnsi(ldsim_message(code)));
    }

    public override bool IsInvalid { get { return handle == IntPtr.Zero; } }
    protected override bool ReleaseHandle() { ldsim_free(handle); return true; }
}

/// <summary>At rest at first, and of one thread at a time. Grabs have the usual stiffness and radius.</summary>
public sealed class Solid : SafeHandle
{
    [DllImport("libldsim")] static extern int ldsim_create(Model model, int grabs, out IntPtr solid);
    [DllImport("libldsim")] static extern void ldsim_destroy(IntPtr solid);
    [DllImport("libldsim")] static extern int ldsim_step(Solid solid, IntPtr record);
    [DllImport("libldsim")] static extern void ldsim_displacements(Solid solid, [Out] double[] u);
    [DllImport("libldsim")] static extern int ldsim_grab(
        Solid solid, double[] point, double[] target, double stiffness, double radius, out uint grab);
    [DllImport("libldsim")] static extern int ldsim_move(Solid solid, uint grab, double[] target);
    [DllImport("libldsim")] static extern int ldsim_release(Solid solid, uint grab);
    [DllImport("libldsim")] static extern int ldsim_force(Solid solid, uint grab, [Out] double[] force);

    public readonly Model Model;
    public readonly double[] Positions; // (vertices, 3), metres, filled by every step
    bool holdsModel;

    public Solid(Model model, int grabs = 4) : base(IntPtr.Zero, true)
    {
        Model = model;
        Model.Check(ldsim_create(model, grabs, out handle));
        model.DangerousAddRef(ref holdsModel); // so that the model is not freed before its solids
        Positions = new double[model.Rest.Length];
        Place();
    }

    public int Step()
    {
        int outcome = ldsim_step(this, IntPtr.Zero);
        Place();
        return outcome;
    }

    void Place() // a condensed solid sags before its first step
    {
        ldsim_displacements(this, Positions);
        for (int i = 0; i < Positions.Length; i++) Positions[i] += Model.Rest[i];
    }

    public uint Grab(double[] point, double[] target)
    {
        uint grab;
        Model.Check(ldsim_grab(this, point, target, 0.0, 0.0, out grab));
        return grab;
    }

    public void Move(uint grab, double[] target) { Model.Check(ldsim_move(this, grab, target)); }
    public void Release(uint grab) { Model.Check(ldsim_release(this, grab)); }
    public void Force(uint grab, double[] newtons) { Model.Check(ldsim_force(this, grab, newtons)); }

    public override bool IsInvalid { get { return handle == IntPtr.Zero; } }
    protected override bool ReleaseHandle()
    {
        ldsim_destroy(handle);
        if (holdsModel) Model.DangerousRelease();
        return true;
    }
}
